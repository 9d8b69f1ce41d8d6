"use strict";
// The list of episodes: filters, pages, keys; notebooks that are loaded when opened. Without it all episodes are shown.
(() => {
  const PAGE = 50;
  const byId = (id) => document.getElementById(id);
  const list = byId("list"), find = byId("find"), shown = byId("shown"), place = byId("place");
  const previous = byId("previous"), next = byId("next");
  const selects = [...document.querySelectorAll("select[data-field]")];
  const episodes = [...list.children].map((node) => ({
    node,
    fields: {
      verdict: [node.dataset.verdict, ...("forgiven" in node.dataset ? ["forgiven"] : [])],
      scene: [node.dataset.scene], category: [node.dataset.category], agent: [node.dataset.agent],
      budget: [node.dataset.budget], outcome: [node.dataset.outcome], mode: node.dataset.modes.split(" "),
      "evidence-verdict": [node.dataset.evidence],
    },
    text: (node.querySelector("summary").textContent + " " + node.dataset.reason).toLowerCase(),
    loading: null,
  }));
  const byNumber = new Map(episodes.map((one) => [one.node.id, one]));
  let matching = episodes, page = 0;

  function filter() {
    const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    const wanted = selects.filter((one) => one.value).map((one) => [one.dataset.field, one.value]);
    matching = episodes.filter((one) => wanted.every(([field, value]) => one.fields[field].includes(value))
      && words.every((word) => one.text.includes(word)));
    show(0);
  }

  function show(number) {
    const pages = Math.max(1, Math.ceil(matching.length / PAGE));
    page = Math.min(Math.max(number, 0), pages - 1);
    list.replaceChildren(...matching.slice(page * PAGE, (page + 1) * PAGE).map((one) => one.node));
    shown.textContent = `${matching.length} of ${episodes.length} episodes.`;
    place.textContent = `Page ${page + 1} of ${pages}`;
    previous.disabled = page === 0;
    next.disabled = page === pages - 1;
    previous.closest("nav").hidden = pages === 1;
  }

  // A notebook that stands beside the page comes as a script that calls this: a page on disk may not fetch.
  const waiting = new Map();
  window.physmentNotebook = (number, html) => waiting.get(number)?.(html);

  function load(one) {
    const number = Number(one.node.id.slice("episode-".length));
    one.loading ??= !list.dataset.pages ? Promise.resolve() : new Promise((done) => {
      const script = document.createElement("script");
      const put = (html) => {
        one.node.insertAdjacentHTML("beforeend", html);
        done();
      };
      waiting.set(number, put);
      script.onerror = () => {
        one.loading = null;
        const said = document.createElement("p");
        said.className = "notebook flag";
        said.textContent = `The notebook is missing: ${list.dataset.pages}/${number}.js belongs beside this page.`;
        one.node.append(said);
        done();
      };
      script.src = `${list.dataset.pages}/${number}.js`;
      document.head.append(script);
    });
    return one.loading;
  }

  async function goTo(hash) {
    const one = byNumber.get((/^#(episode-\d+)/.exec(hash) ?? [])[1]);
    if (!one) return;
    if (!matching.includes(one)) clear();
    const number = Math.floor(matching.indexOf(one) / PAGE);
    if (number !== page) show(number);
    one.node.open = true;
    await load(one);
    const target = byId(hash.slice(1)) ?? one.node;
    for (const old of list.querySelectorAll(".target")) old.classList.remove("target");
    target.classList.add("target");
    target.scrollIntoView({ block: target === one.node ? "start" : "center" });
    const focused = target === one.node ? target.firstElementChild : target;
    if (focused !== one.node.firstElementChild) focused.tabIndex = -1;
    focused.focus({ preventScroll: true });
  }

  function clear() {
    find.value = "";
    for (const one of selects) one.value = "";
    filter();
  }

  function openAll(open) {
    for (const one of list.children) one.open = open;
  }

  function move(event) {
    const summaries = [...list.children].map((one) => one.firstElementChild);
    const at = summaries.indexOf(event.target);
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: summaries.length - 1 }[event.key];
    if (at < 0 || to === undefined || !summaries[to]) return;
    event.preventDefault();
    summaries[to].focus();
  }

  for (const one of document.querySelectorAll(".scripted")) one.hidden = false;
  find.addEventListener("input", filter);
  for (const one of selects) one.addEventListener("change", filter);
  byId("clear").addEventListener("click", clear);
  byId("open").addEventListener("click", () => openAll(true));
  byId("close").addEventListener("click", () => openAll(false));
  previous.addEventListener("click", () => show(page - 1));
  next.addEventListener("click", () => show(page + 1));
  list.addEventListener("keydown", move);
  list.addEventListener("toggle", (event) => {
    const one = byNumber.get(event.target.id);
    if (one && event.target.open) load(one);
  }, true);
  // The player of films is large, so it is loaded with the first film.
  let player = null;
  function showFilm(place) {
    player ??= new Promise((done, failed) => {
      const script = document.createElement("script");
      Object.assign(script, { src: "film.js", onload: done, onerror: failed });
      document.head.append(script);
    });
    player.then(() => window.physmentShowFilm(place), () => {
      player = null;
      place.append("The player of films is missing: film.js belongs beside this page.");
    });
  }

  document.addEventListener("click", (event) => {
    if (event.target.matches?.(".film > button")) showFilm(event.target.parentElement);
    const link = event.target.closest?.("a[href^='#']");
    if (!link) return;
    if (link.dataset.filter) {
      clear();
      for (const [field, value] of new URLSearchParams(link.dataset.filter)) byId(field).value = value;
      filter();
    } else if (link.hash === location.hash) goTo(link.hash);
  });
  window.addEventListener("hashchange", () => goTo(location.hash));
  filter();
  goTo(location.hash);
})();

"use strict";
// The list of episodes: filters, pages, keys; notebooks that are loaded when opened. Without it all episodes are shown.
(() => {
  const PAGE = 50;
  const byId = (id) => document.getElementById(id);
  const list = byId("list"), find = byId("find"), shown = byId("shown"), place = byId("place");
  const previous = byId("previous"), next = byId("next");
  const selects = [...document.querySelectorAll("select[data-field]")];
  const fields = new Set(["find", ...selects.map((one) => one.id)]);
  // A large report holds its rows in a noscript element, which a browser with scripts reads as text: thousands of rows
  // that are laid out and then removed took two thirds of the time until the page could be used.
  const text = list.querySelector(":scope > noscript")?.textContent;
  const rows = text === undefined ? list : new DOMParser().parseFromString(text, "text/html").body;
  const episodes = [...rows.children].map((node) => ({
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

  // What is chosen stands in the address, so that it can be kept and sent: #episodes?scene=28&find=cord.
  function remember() {
    const chosen = [...selects.map((one) => [one.id, one.value]), ["find", find.value]].filter(([, value]) => value);
    history.replaceState(null, "", "#episodes" + (chosen.length ? `?${new URLSearchParams(chosen)}` : ""));
  }

  function recall(hash) {
    const [, wanted] = /^#episodes\?(.*)$/.exec(hash) ?? [];
    if (wanted === undefined) return false;
    clear();
    for (const [id, value] of new URLSearchParams(wanted)) if (fields.has(id)) byId(id).value = value;
    filter();
    byId("episodes").scrollIntoView();
    byId("episodes").focus({ preventScroll: true });
    return true;
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
    if (recall(hash)) return;
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
  const changed = () => {
    filter();
    remember();
  };
  find.addEventListener("input", changed);
  for (const one of selects) one.addEventListener("change", changed);
  byId("clear").addEventListener("click", () => {
    clear();
    remember();
  });
  byId("open").addEventListener("click", () => openAll(true));
  byId("close").addEventListener("click", () => openAll(false));
  previous.addEventListener("click", () => show(page - 1));
  next.addEventListener("click", () => show(page + 1));
  list.addEventListener("keydown", move);
  list.addEventListener("toggle", (event) => {
    const one = byNumber.get(event.target.id);
    if (one && event.target.open) load(one);
  }, true);
  // The cells of an agent are one stop of the Tab key; arrow keys move among all cells.
  const grid = [...document.querySelectorAll(".verdicts ul")].map((row) => [...row.children].map((one) => one.firstElementChild));
  for (const row of grid) row.filter(Boolean).slice(1).forEach((cell) => (cell.tabIndex = -1));
  grid.forEach((row, r) => row.forEach((cell, c) => cell?.addEventListener("keydown", (event) => {
    const [down, right] = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] }[event.key] ?? [];
    if (down === undefined) return;
    event.preventDefault();
    for (let [y, x] = [r + down, c + right]; grid[y] && x >= 0 && x < row.length; [y, x] = [y + down, x + right]) {
      const next = grid[y][x];
      if (!next) continue;
      for (const other of grid[y]) if (other) other.tabIndex = other === next ? 0 : -1;
      next.focus();
      return;
    }
  })));
  for (const kind of ["pointerover", "focusin"]) document.addEventListener(kind, (event) => {
    const cell = event.target.closest?.(".verdicts a");
    if (cell) byId("pointed").textContent = cell.title;
  });

  // A press on the title of a column sorts by it; cells without a number come last.
  function sortBy(head) {
    const table = head.closest("table"), column = head.cellIndex, before = head.getAttribute("aria-sort");
    const way = before === "descending" ? 1 : -1;
    for (const one of table.tHead.rows[0].cells) one.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
    const value = (row) => {
      const text = row.cells[column].textContent.trim().replace("−", "-");
      const number = parseFloat(text.replace(/^\D*?(?=-?\d)/, ""));
      return column === 0 ? text : Number.isNaN(number) ? null : number;
    };
    const body = table.tBodies[0], sorted = [...body.rows].map((row) => [value(row), row]);
    sorted.sort(([a], [b]) => (a === null) - (b === null)
      || way * (typeof a === "string" ? a.localeCompare(b, undefined, { numeric: true }) : a - b));
    body.append(...sorted.map(([, row]) => row));
  }

  for (const table of document.querySelectorAll("main .wide > table")) {
    if (table.tBodies.length !== 1 || table.tBodies[0].rows.length < 2 || table.querySelector("[rowspan], [colspan]")) continue;
    for (const head of table.tHead.rows[0].cells) {
      if (table.tBodies[0].rows[0].cells[head.cellIndex]?.classList.contains("bar")) continue;
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => sortBy(head));
    }
  }

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
      event.preventDefault();
      const hash = `#episodes?${link.dataset.filter}`;
      if (location.hash === hash) recall(hash);
      else location.hash = hash;
    } else if (link.hash === location.hash) goTo(link.hash);
  });
  window.addEventListener("hashchange", () => goTo(location.hash));
  filter();
  goTo(location.hash);
})();

"""Tests of the page of a run: it shows the records, loads nothing from other hosts, and escapes agents' texts."""

import base64
import hashlib
import re
from dataclasses import replace
from html.parser import HTMLParser

from evaluator.records.episode import Exchange, Fork, Outcome, Turn
from evaluator.records.run import ForkedRun, Plan, RunRecord, ServerRecord
from evaluator.report.agent_results import Run
from evaluator.report.notebook import question
from evaluator.report.page import render
from evaluator.scores.scored_episode import ScoredEpisode
from tests.builders.records import RIGHT, episode, episode_key, grade, refused, returned, turn
from tests.builders.scored import scored

EVIL = "</pre><script>alert('x')</script><img src=x onerror=alert(1)> {{ 7*7 }}"
RECORD = RunRecord(
    created_at="2026-01-01T00:00:00+00:00",
    plan=Plan(scenes=(7, 21), agents=(f"agent {EVIL}",), budgets=(5,)),
    server=ServerRecord(option="stdio"),
)


def row(scene: int, right: bool | None, category: str, said: str = "I look.") -> ScoredEpisode:
    """An episode whose texts are all the same; without a verdict if `right` is None."""
    key = episode_key(scene, budget=5)
    if right is None:
        played = episode(key=key, outcome=Outcome.INFRASTRUCTURE_ERROR, prompt=said, error=said)
    else:
        look = turn(said, refused("step", said, duration=0.1, note=said)).model_copy(update={"note": said})
        played = episode(look, key=key, answer=said, prompt=said)
    return scored(played, grade(right, reason=said), category, "calculation")


def page(*rows: ScoredEpisode) -> str:
    return render([Run("run", RECORD, rows, {})]).page


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in {"meta", "input", "br", "col"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def tags(text: str) -> _Tags:
    parser = _Tags()
    parser.feed(text)
    return parser


def test_nothing_an_agent_wrote_becomes_markup() -> None:
    text = page(row(7, True, "easy-single", EVIL), row(21, None, "hard-single", EVIL))
    parsed = tags(text)
    assert parsed.open == []
    assert [tag for tag, _ in parsed.seen if tag == "script"] == ["script"]
    assert not [tag for tag, _ in parsed.seen if tag == "img"]
    assert "&lt;script&gt;alert" in text
    assert "{{ 7*7 }}" in text


def test_the_page_loads_nothing_from_other_places() -> None:
    text = page(row(7, True, "easy-single"))
    assert not re.search(r"https?://|//cdn|@import|url\(", text)
    assert not [tag for tag, attributes in tags(text).seen if tag == "link" or attributes.get("src")]


def test_the_numbers_are_those_of_the_records() -> None:
    text = page(
        row(7, True, "easy-single"),
        row(16, False, "easy-single-creation"),
        row(21, None, "easy-single-hidden"),
    )
    assert "1 of 2; 95&nbsp;% interval 9.5\N{NO-BREAK SPACE}% to 90.5\N{NO-BREAK SPACE}%" in text
    assert text.count('data-verdict="correct"') == text.count('data-verdict="incorrect"') == 1
    assert text.count('data-verdict="unscored"') == 1
    assert "Infrastructure error" in text


def test_tables_and_headings_are_labelled_for_screen_readers() -> None:
    parsed = tags(page(row(7, True, "easy-single")))
    names = [tag for tag, _ in parsed.seen]
    assert names.count("caption") == names.count("table")
    assert all(attributes.get("scope") in {"row", "col"} for tag, attributes in parsed.seen if tag == "th")
    assert [attributes for tag, attributes in parsed.seen if tag == "html"] == [{"lang": "en"}]
    assert "main" in names
    assert "h1" in names


def test_the_page_allows_its_own_script_and_no_other() -> None:
    text = page(row(7, True, "easy-single"))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    script = re.search(r"<script>(.*?)</script>", text, re.DOTALL)
    assert policy is not None
    assert script is not None
    own = base64.b64encode(hashlib.sha256(script[1].encode()).digest()).decode()
    assert "default-src 'none'" in policy[1]
    assert f"script-src 'sha256-{own}';" in policy[1]
    assert not [name for _, attributes in tags(text).seen for name in attributes if name.startswith("on")]


def test_every_link_of_the_page_has_its_target_in_the_page() -> None:
    parsed = tags(page(row(7, True, "easy-single"), row(21, None, "hard-single")))
    ids = [attributes["id"] for _, attributes in parsed.seen if "id" in attributes]
    links = [attributes["href"] for tag, attributes in parsed.seen if tag == "a"]
    assert len(ids) == len(set(ids))
    assert links
    assert {f"#{name}" for name in ids} >= set(links)


def played(seed: int, budget: int, *turns: Turn) -> ScoredEpisode:
    key = episode_key(seed=seed, budget=budget)
    return scored(episode(*turns, key=key, answer="1.5", prompt="task"), RIGHT, "easy-single", "calculation")


def look(text: str) -> Exchange:
    found = returned("get_velocity", {"velocity": [0.0, 0.0, -7.848]}, object_id="object_1")
    return found.model_copy(update={"text": text})


def test_provenance_names_the_programs_that_met_other_seeds_and_what_the_seal_says() -> None:
    plan = RECORD.plan.model_copy(update={"own_seeds": ("external:x",)})
    record = RECORD.model_copy(update={"plan": plan})
    text = render([Run("run", record, [row(7, True, "easy-single")], {}, seal="1 sealed, abc")]).page
    assert "other ones at each further budget, epoch and prompt for external:x" in text
    assert "<dt>Records</dt><dd>1 sealed, abc</dd>" in text
    usual = page(row(7, True, "easy-single"))
    assert "other ones at each" not in usual
    assert "<dt>Records</dt>" not in usual


def test_provenance_names_split_held_back_seeds_and_the_run_that_was_forked() -> None:
    plan = RECORD.plan.model_copy(update={"split": "held-back", "held_back": "c0ffee"})
    forked = ForkedRun(folder="<b>earlier</b>", seal_head="abc", turn=2)
    record = RECORD.model_copy(update={"plan": plan, "forked_from": forked})
    before = row(7, True, "easy-single")
    fork = Fork(key=episode_key(agent="first"), turn=2, record_sha256="0")
    again = replace(before, episode=before.episode.model_copy(update={"forked_from": fork}))
    text = render([Run("run", record, [again], {})]).page
    assert "<dt>Split</dt><dd>held-back</dd>" in text
    assert "held back; numbers of variants 0, drawn with the key of commitment <code>c0ffee</code>" in text
    assert "episodes of &lt;b&gt;earlier&lt;/b&gt;, continued after iteration 2; its seal is <code>abc</code>" in text
    assert "the first 2 turns are those of first" in text
    assert "made by first" in text
    assert "Scene 7, variant 0" in text
    usual = page(before)
    assert "<dt>Split</dt>" not in usual
    assert "<dt>Forked</dt>" not in usual
    assert "made by" not in usual
    assert "Scene 7, seed 0" in usual


def test_an_episode_that_is_too_long_is_cut_and_says_so() -> None:
    said = ["x" * 400_000 + f" end of the {place}" for place in ("first", "second", "third", "fourth")]
    text = page(played(0, 20, *(turn(part, look("-7.848")) for part in said)))
    assert len(text) < 1_300_000
    assert "end of the second" in text
    assert "end of the third" not in text
    assert "2 further iterations would make this page too long" in text
    whole = page(played(0, 20, turn("x" * 2_000_000 + " end")))
    assert " end" in whole, "the first iteration is always shown"


def test_the_exact_text_of_every_call_can_be_unfolded_under_its_turn() -> None:
    text = page(played(0, 5, turn("", look('{"velocity":[0.0,0.0,-7.848000000000001]}'))))
    exact = text[text.index("<summary>exact texts</summary>") :]
    assert "1. get_velocity {&#34;object_id&#34;: &#34;object_1&#34;}" in exact
    assert "→ {&#34;velocity&#34;: [0.0, 0.0, -7.848000000000001]}" in exact
    assert '<td>velocity</td><td>(0, 0, -7.848) <span class="soft">m/s</span></td>' in text


def test_the_model_s_own_reasoning_is_folded_and_its_reply_is_not() -> None:
    said = turn("First 1.5 m, then I look. It is 2.5 m.").model_copy(update={"thought_chars": 26})
    text = page(played(0, 5, said))
    assert re.search(
        r"as the provider shows it: 26 characters</summary><p class=.said.>First .*1\.5 m.*look\. </p>", text
    )
    assert re.search(r"</details>\s*<p class=.said.>It is .*2\.5 m", text)


def test_open_worlds_are_shown_apart_from_the_accuracy_of_the_suite() -> None:
    text = page(row(7, True, "easy-single"), row(201, False, "open"), row(202, True, "open"))
    assert "1 of 1; 95&nbsp;% interval" in text
    ladder = text[text.index('<h2 id="ladder">') : text.index('<h2 id="budgets">')]
    assert '<th scope="col">open: all predictions right</th>' in ladder
    assert ">50.0&nbsp;% <small>9 to 91, n 2</small></td>" in ladder
    assert "How episodes in open worlds ended" in ladder
    assert "no other number on this page" in text
    assert "in open worlds" not in page(row(7, True, "easy-single"))


def test_a_page_of_open_worlds_alone_has_no_sections_of_the_suite_and_no_dead_links() -> None:
    text = page(row(201, False, "open"), row(202, None, "open"))
    assert "Only open worlds were played" in text
    assert "<dt>Strict accuracy</dt>" not in text
    parsed = tags(text)
    ids = {attributes["id"] for _, attributes in parsed.seen if "id" in attributes}
    assert not {"budgets", "categories", "dimensions", "failures"} & ids
    assert {f"#{name}" for name in ids} >= {attributes["href"] for tag, attributes in parsed.seen if tag == "a"}


def test_a_baseline_and_an_unsealed_agent_are_marked_in_a_report_of_open_worlds_alone() -> None:
    def world(scene: int, agent: str, unsealed: str | None) -> ScoredEpisode:
        played = episode(turn("I look."), key=episode_key(scene, agent=agent))
        return scored(played.model_copy(update={"unsealed": unsealed}), RIGHT, "open")

    text = page(world(201, "random", None), world(201, "external:x", "it could read the packs"))
    assert ">random <small>baseline</small></th>" in text
    assert '>external:x <small class="flag">unsealed</small></th>' in text


def test_a_stated_number_links_to_its_return_and_a_number_without_support_is_marked() -> None:
    first = turn("I look.", look('{"velocity": [0.0, 0.0, -7.848]}'))
    second = turn("It is -7.85 m/s,\nand the mass is 55.3 kg.")
    text = page(played(0, 5, first, second))
    assert 'href="#episode-1-1-1" title="returned as -7.848 at $.velocity[2]">-7.85 m/s</a>,\nand the mass is' in text
    assert 'title="no earlier return supports this number">55.3 kg</span>.</p>' in text
    assert 'id="episode-1-1-1"' in text


def test_episodes_are_labelled_by_what_differs_and_sorted_as_numbers() -> None:
    several = page(*(played(seed, budget) for seed in (10, 2) for budget in (10, 5)))
    names = re.findall(r"Scene 7, seed \d+, budget \d+", several)
    assert names == [f"Scene 7, seed {seed}, budget {budget}" for seed in (2, 10) for budget in (5, 10)]
    assert "budget" not in str(re.findall(r"<span>Scene.*?</span>", page(played(0, 5), played(1, 5))))


def test_an_undefined_number_is_shown_as_a_dash() -> None:
    text = page(row(7, None, "easy-single"))
    assert "None" not in text
    assert re.search(r"<dt>Strict accuracy</dt><dd>–", text)
    assert "C –, E –, G –, G+ –, V –, R –" in text


def test_a_return_that_is_no_json_or_not_encodable_is_shown_as_received() -> None:
    hostile = ['"\\ud800"', "[" * 5000, "9" * 5000, "not JSON", "NaN", ""]
    text = page(played(0, 5, turn("", *map(look, hostile))))
    assert text.encode()
    assert "→ &#34;\\ud800&#34;" in text
    assert "→ not JSON" in text


def test_the_question_stands_above_the_calls_and_is_not_folded() -> None:
    prompt = "You are a physicist.\n\n# Scene: A ball\n\nHow fast is it?\nAnd <when>?\n\n# Objects\n\n| id |"
    assert question(prompt) == "How fast is it?\nAnd <when>?"
    assert question("no headings") == ""


def test_long_returns_are_broken_into_lines_and_vectors_are_not() -> None:
    text = page(played(0, 5, turn("", look('{"a": [1, 2, 3], "b": "%s"}' % ("x" * 90)))))
    assert "→ {\n  &#34;a&#34;: [1, 2, 3],\n  &#34;b&#34;: &#34;xxx" in text

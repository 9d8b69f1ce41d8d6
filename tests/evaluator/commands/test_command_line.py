"""Tests of the commands as an operator uses them: exit codes, messages, files, interruption."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from evaluator.commands.base import PROMPTINGS, PROTOCOLS
from evaluator.commands.overview import COMMANDS
from evaluator.commands.program import main
from evaluator.records.episode import Outcome
from evaluator.store.run_folder import RunFolder
from scenes import default_folder
from tests.builders.commands import heed_signals, physment_eval

COMMAND = [sys.executable, "-m", "evaluator"]

DYING = """
import sys
import anyio
import mcp_types as types
from mcp.server.lowlevel import Server
from mcp.server.stdio import stdio_server

calls = 0

async def list_tools(ctx, params):
    tools = [types.Tool(name=name, input_schema={"type": "object"}) for name in ("step", "answer")]
    return types.ListToolsResult(tools=tools)

async def call_tool(ctx, params):
    global calls
    calls += 1
    if calls == 2:
        print("out of smoke", file=sys.stderr, flush=True)
        import os
        os._exit(3)
    return types.CallToolResult(content=[types.TextContent(type="text", text="{}")], structured_content={})

async def get_prompt(ctx, params):
    message = types.PromptMessage(role="user", content=types.TextContent(type="text", text="task"))
    return types.GetPromptResult(messages=[message])

async def run():
    server = Server("dying", on_list_tools=list_tools, on_call_tool=call_tool, on_get_prompt=get_prompt)
    async with stdio_server() as (read, write):
        await server.run(read, write, server.create_initialization_options())

anyio.run(run)
"""


def refused(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    """Run a command that must be refused, and return its one-sentence error message."""
    assert main([str(word) for word in words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.strip().splitlines()) == 1
    assert said.err.startswith("physment-eval: ")
    return said.err


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("prompting", PROMPTINGS)
def test_every_prompting_and_protocol_can_be_played(
    prompting: str, protocol: str, tmp_path: Path, host_url: str
) -> None:
    words = [
        "--server",
        host_url,
        "--agent",
        "blind",
        "--scenes",
        "7",
        "--prompting",
        prompting,
        "--protocol",
        protocol,
    ]
    assert main([*words, "--out", str(tmp_path / "run")]) == 0
    (episode,) = RunFolder(tmp_path / "run").episodes().values()
    assert (episode.outcome, episode.key.prompting) == (Outcome.ANSWERED, prompting)


@pytest.mark.parametrize(
    "words", [["--help"], ["run", "--help"], ["grade", "--help"], ["report", "--help"], ["--version"]]
)
def test_help_is_printed_and_succeeds(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    assert "physment-eval" in capsys.readouterr().out


def test_run_is_the_default_command_and_writes_all_files_of_a_run_folder(tmp_path: Path) -> None:
    command = [*COMMAND, "--server", "stdio", "--scenes", "7", "--out", "run"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "strict accuracy 100.0 % (1/1)" in done.stdout
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names == {"run.json", "episodes.jsonl", "grades.jsonl", "summary.json", "report.html", "seal.json"}
    facts = json.loads((tmp_path / "run" / "run.json").read_text(encoding="utf-8"))
    assert facts["server"]["tools"] == 26
    assert facts["versions"]["mujoco"] == "3.3.3"


def test_json_prints_one_object_and_the_rest_goes_to_stderr(tmp_path: Path, host_url: str) -> None:
    done = physment_eval("--server", host_url, "--scenes", "7,21", "--out", "run", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["overall"]["n_correct"] == 2
    assert "strict accuracy" in done.stderr


def test_a_run_of_several_agents_names_each_and_pools_none(tmp_path: Path, host_url: str) -> None:
    agents = ("--agent", "reference", "--agent", "blind")
    said = physment_eval("--server", host_url, *agents, "--scenes", "7,21", "--out", "run", cwd=tmp_path).stdout
    progress = [line for line in said.splitlines() if re.match(r"\[\d/4\] ", line)]
    assert [sum(f"] {agent}, scene " in line for line in progress) for agent in ("reference", "blind")] == [2, 2]
    assert {"reference 2/2 right", "blind 0/2 right"} < set(re.findall(r"\w+ \d/\d right", said))
    assert "/4 right" not in said
    table = [line.split()[:2] for line in said.splitlines() if re.match(r"(blind|reference) +\d", line)]
    assert table == [["blind", "7"], ["reference", "7"], ["blind", "21"], ["reference", "21"]]
    assert "reference: strict accuracy 100.0 % (2/2)" in said
    assert "blind: strict accuracy 0.0 % (0/2)" in said


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--budgets", "0"], "--budgets 0: must be 1 or more"),
        (["--scenes", "999"], "there is no such scene"),
        (["--agent", "genius"], "there is no such agent"),
        (["--seeds", "x"], "--seeds x: write whole numbers"),
        (["--seeds", "1-999999999"], "--seeds 1-999999999: names more than 1,000,000 numbers; write a shorter range"),
        (["--seeds", "1-900000", "--epochs", "2"], "make 1,800,000 episodes; a run has at most 1,000,000"),
        (["--resume"], "--resume needs the folder"),
        (["--server", "no-such-program --scene {scene}"], "the server command 'no-such-program --scene 7' failed"),
        (["--server", f"{sys.executable} -c raise(SystemExit('no-licence'))"], "no-licence"),
        (["--server", "no-such-program"], "there is no such program"),
        (["--server", "http://127.0.0.1:9"], "cannot be reached: nothing accepts connections there; start"),
        (["--server", "htp://foo"], "--server htp://foo: not the URL of a host, such as http://127.0.0.1:8000"),
        (["--scne", "7"], "there is no option --scne; did you mean --scene? (see physment-eval run --help)"),
        (["--xyzzy=7"], "there is no option --xyzzy (see physment-eval run --help)"),
        (["--executor", "rai"], "--executor: rai is none of local, ray; did you mean ray?"),
    ],
    ids=lambda value: " ".join(value)[:40] if isinstance(value, list) else "",
)
def test_wrong_usage_gives_one_sentence_and_leaves_no_files(
    words: list[str], problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = [] if words == ["--resume"] else ["--out", tmp_path / "run"]
    scene = [] if "--scenes" in words else ["--scenes", "7"]
    said = refused(capsys, "run", *words, *scene, *out)
    assert problem in said
    assert "Error(" not in said, "an error of Python is not for operators"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["reprot", "runs/x"], "there is no command reprot; did you mean report? (see physment-eval --help)"),
        (["quux"], "there is no command quux (see physment-eval --help)"),
        (["scenes", "lst"], "there is no command lst; did you mean list? (see physment-eval scenes --help)"),
        (
            ["scenes", "show", "7", "--sede", "3"],
            "there is no option --sede; did you mean --seed? (see physment-eval scenes show --help)",
        ),
        (["--scne", "7"], "there is no option --scne; did you mean --scene? (see physment-eval run --help)"),
        (
            ["play", "--scnee", "7"],
            "there is no option --scnee; scene is written without dashes: physment-eval play N"
            " (see physment-eval play --help)",
        ),
        (
            ["play", "--bugdet", "7"],
            "there is no option --bugdet; did you mean --budget? (see physment-eval play --help)",
        ),
        (["watch"], "the following arguments are required: DIR (see physment-eval watch --help)"),
    ],
)
def test_a_mistyped_command_or_option_is_answered_with_the_nearest(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(capsys, *words) == f"physment-eval: {said}\n"


@pytest.fixture
def packs(tmp_path: Path) -> Path:
    """A folder with one pack, which a test may damage."""
    shutil.copytree(default_folder() / "Scene7", tmp_path / "packs" / "Scene7")
    return tmp_path / "packs"


def test_a_malformed_pack_is_reported_with_file_field_and_reason(
    packs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = packs / "Scene7" / "scene7.json"
    raw = json.loads(file.read_text(encoding="utf-8"))
    del raw["metadata"]["task"]
    file.write_text(json.dumps(raw), encoding="utf-8")
    said = refused(capsys, "run", "--scenes-dir", packs, "--out", packs.parent / "run")
    assert all(part in said for part in ("scene7.json", "field metadata.task", "Field required"))


def test_a_scene_that_does_not_compile_is_reported_with_the_engines_reason(
    packs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = packs / "Scene7" / "scene7.xml"
    file.write_text(file.read_text(encoding="utf-8").replace('type="sphere"', 'type="sfere"'), encoding="utf-8")
    for server in ("stdio", "host"):
        said = refused(capsys, "run", "--server", server, "--scenes-dir", packs, "--out", packs.parent / "run")
        assert "does not compile" in said


def test_a_run_folder_in_use_and_one_that_cannot_be_written_are_refused(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "--server", host_url, "--scenes", "7", "--out", str(tmp_path / "run")]) == 0
    capsys.readouterr()
    assert "add --resume" in refused(capsys, "run", "--scenes", "7", "--out", tmp_path / "run")
    said = refused(capsys, "run", "--scenes", "7,21", "--out", tmp_path / "run", "--resume")
    assert "holds a run with other plan" in said
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert "cannot be written" in refused(capsys, "run", "--scenes", "7", "--out", tmp_path / "file" / "run")
    assert "is not a run folder" in refused(capsys, "grade", tmp_path)


def test_a_server_that_dies_is_retried_recorded_and_never_scored_wrong(tmp_path: Path) -> None:
    (tmp_path / "dying.py").write_text(DYING, encoding="utf-8")
    turns = [[{"tool": "step", "arguments": {}}], [{"tool": "answer", "arguments": {"answer": 1}}]]
    (tmp_path / "turns.json").write_text(json.dumps(turns), encoding="utf-8")
    server = f"{sys.executable} dying.py"
    done = physment_eval(
        "--server", server, "--agent", "scripted:turns.json", "--scenes", "7", "--out", "run", "--json", cwd=tmp_path
    )
    assert done.returncode == 1
    (line,) = (tmp_path / "run" / "episodes.jsonl").read_text(encoding="utf-8").splitlines()
    episode = json.loads(line)
    assert (episode["outcome"], episode["attempts"]) == ("infrastructure_error", 3)
    assert "out of smoke" in episode["error"]
    overall = json.loads(done.stdout)["overall"]
    assert (overall["n"], overall["n_scored"], overall["strict_accuracy"]) == (1, 0, None)


def _keys(folder: Path) -> list[tuple[int, int]]:
    lines = (folder / "episodes.jsonl").read_text(encoding="utf-8").splitlines()
    return [(key["scene"], key["seed"]) for key in (json.loads(line)["key"] for line in lines)]


def _start_and_stop(
    tmp_path: Path, server: str, how: signal.Signals, after: int, *more: str, background: bool = False
) -> int:
    """Start a run of 40 episodes, stop it when some of them are on disk, and return its exit code.

    Args:
        tmp_path: Working folder.
        server: Value of `--server`.
        how: Signal that stops the run.
        after: Number of episodes.
        more: Further options.
        background: Whether Ctrl-C is ignored, as in a background job of a script.
    """
    command = [*COMMAND, "--server", server, "--agent", "random", "--scenes", "7,21", "--seeds", "0-19", "--out", "run"]
    command += more
    with subprocess.Popen(
        ["sh", "-c", "trap '' INT; exec \"$@\"", "sh", *command] if background else command,
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_signals,  # noqa: PLW1509 - no threads are started before it
    ) as process:
        assert process.stdout is not None
        for _ in range(after):
            assert process.stdout.readline()
        os.killpg(process.pid, how) if how is signal.SIGKILL else process.send_signal(how)
        _, errors = process.communicate(timeout=300)
        assert "Traceback" not in errors
        return process.returncode


def _processes_of_session(folder: Path) -> list[str]:
    """Return the commands of the processes that a run left behind: those with this working folder."""
    found: list[str] = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if (process / "cwd").readlink() == folder:
                found.append((process / "cmdline").read_text(encoding="utf-8").replace("\0", " "))
    return found


@pytest.mark.parametrize("after", [pytest.param(1, marks=pytest.mark.extended), 23])
def test_a_killed_run_is_completed_and_no_episode_is_lost_or_recorded_twice(
    tmp_path: Path, host_url: str, after: int
) -> None:
    assert _start_and_stop(tmp_path, host_url, signal.SIGKILL, after) == -signal.SIGKILL
    torn = tmp_path / "run" / "episodes.jsonl"
    with torn.open("a", encoding="utf-8") as stream:
        stream.write('{"format": 1, "key": {"sce')
    on_disk = len(torn.read_text(encoding="utf-8").splitlines()) - 1
    assert after <= on_disk < 40
    done = physment_eval(
        *("--server", host_url, "--agent", "random", "--scenes", "7,21", "--seeds", "0-19", "--out", "run", "--resume"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert f"[{40 - on_disk}/{40 - on_disk}]" in done.stdout
    keys = _keys(tmp_path / "run")
    assert len(keys) == len(set(keys)) == 40


def test_a_resumed_run_sets_a_damaged_line_aside_and_plays_its_episode_again(tmp_path: Path, host_url: str) -> None:
    words = ("--server", host_url, "--agent", "random", "--scenes", "7", "--seeds", "0-2", "--out", "run")
    assert physment_eval(*words, cwd=tmp_path).returncode == 0
    file = tmp_path / "run" / "episodes.jsonl"
    first, _, last = _whole_lines(tmp_path / "run")
    file.write_bytes(b"\n".join([first, b"garbage", last, b""]))
    refused = physment_eval("grade", "run", cwd=tmp_path)
    assert refused.returncode == 2
    assert "line 2 is damaged" in refused.stderr
    assert "--resume" in refused.stderr
    done = physment_eval(*words, "--resume", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "line 2 was damaged" in done.stderr
    assert sorted(_keys(tmp_path / "run")) == [(7, 0), (7, 1), (7, 2)]


@pytest.mark.extended
def test_a_run_that_was_killed_twice_has_the_results_of_an_undisturbed_run(tmp_path: Path, host_url: str) -> None:
    words = ("--server", host_url, "--agent", "random", "--scenes", "7,21", "--seeds", "0-7", "--out", "run")
    random, on_disk = Random(20), 0
    for _ in range(2):
        _start_and_stop(tmp_path, host_url, signal.SIGKILL, random.randint(1, 5), "--seeds", "0-7", "--resume")
        grown = len(_whole_lines(tmp_path / "run"))
        assert on_disk < grown < 16
        on_disk = grown
    done = physment_eval(*words, "--resume", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(_keys(tmp_path / "run")) == len(set(_keys(tmp_path / "run"))) == 16
    whole = physment_eval(*words[:-1], "whole", "--json", cwd=tmp_path)
    assert json.loads(done.stdout) == json.loads(whole.stdout)


def _whole_lines(folder: Path) -> list[bytes]:
    return (folder / "episodes.jsonl").read_bytes().split(b"\n")[:-1]


@pytest.mark.parametrize(
    ("how", "background"),
    [
        (signal.SIGINT, False),
        (signal.SIGTERM, True),
        pytest.param(signal.SIGTERM, False, marks=pytest.mark.extended),
        pytest.param(signal.SIGHUP, False, marks=pytest.mark.extended),
    ],
)
def test_an_interrupted_run_says_how_to_continue_and_leaves_a_usable_folder(
    tmp_path: Path, how: signal.Signals, *, background: bool
) -> None:
    assert _start_and_stop(tmp_path, "host", how, 3, "--seeds", "0-199", "--unproved", background=background) == 130
    assert _processes_of_session(tmp_path) == []
    keys = _keys(tmp_path / "run")
    assert 3 <= len(keys) < 400
    done = physment_eval("grade", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "report.html").exists()


def test_a_report_is_written_again_from_a_graded_folder_alone(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert main(["--server", host_url, "--scenes", "7", "--out", str(folder)]) == 0
    before = (folder / "report.html").read_bytes()
    (folder / "report.html").unlink()
    capsys.readouterr()
    assert main(["report", str(folder)]) == 0
    assert capsys.readouterr().out == f"{folder / 'report.html'}\n"
    assert (folder / "report.html").read_bytes() == before
    (folder / "grades.jsonl").unlink()
    assert "not every episode is graded; run `physment-eval grade" in refused(capsys, "report", folder)


def test_a_run_folder_that_is_damaged_is_refused_with_file_and_line(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert main(["--server", host_url, "--scenes", "7", "--out", str(folder)]) == 0
    capsys.readouterr()
    file = folder / "episodes.jsonl"
    file.write_bytes(b'{"format": 1}\n' + file.read_bytes())
    for words in (["grade", folder], ["report", folder]):
        assert "episodes.jsonl, line 1 is damaged: key: Field required" in refused(capsys, *words)
    (folder / "run.json").write_text("{", encoding="utf-8")
    assert "run.json cannot be read" in refused(capsys, "report", folder)


def test_text_of_an_agent_cannot_damage_a_run_or_its_report(tmp_path: Path, host_url: str) -> None:
    """Agents write unusual line ends, lone surrogates and markup; store, grades, table and report are checked."""
    evil = "[/x][red]7\u2028\x85\x1b[31m</script><script>alert(1)</script>\u202e"
    turns = [
        [{"tool": "step", "arguments": {"duration": 0.1, "\ud800": 1}}],
        [{"tool": f"step{evil}", "arguments": {evil: evil}}],
        [{"tool": "answer", "arguments": {"answer": evil}}],
    ]
    (tmp_path / "turns.json").write_text(json.dumps(turns), encoding="utf-8")
    words = ("--server", host_url, "--agent", "scripted:turns.json", "--scenes", "7,21", "--out", "run")
    done = physment_eval(*words, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "\x1b" not in done.stdout
    assert "[/x][red]7\\u2028" in "".join(done.stdout.split())
    assert physment_eval("grade", "run", cwd=tmp_path).returncode == 0
    again = physment_eval(*words, "--resume", cwd=tmp_path)
    assert (again.returncode, again.stderr) == (0, "")
    assert (tmp_path / "run" / "report.html").read_text(encoding="utf-8").count("<script") == 1


def test_a_signal_ends_the_program_where_it_awaits_something_and_not_in_the_middle_of_a_function() -> None:
    code = """
import signal
import anyio
from evaluator.commands.base import run_async

def interrupt(sign, frame):
    raise KeyboardInterrupt

async def work():
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(write_record)
        await anyio.sleep_forever()

async def write_record():
    try:
        signal.raise_signal(signal.SIGTERM)
        print("written")
        await anyio.sleep_forever()
    finally:
        print("closed")

signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, interrupt)
try:
    run_async(work)
except KeyboardInterrupt:
    print("interrupted", signal.getsignal(signal.SIGTERM) is interrupt)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("written\nclosed\ninterrupted True\n", "")


def test_ctrl_c_before_the_first_episode_is_told_in_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    def press() -> None:
        raise KeyboardInterrupt

    assert main(["--dry-run"], begin=press) == 130
    assert capsys.readouterr() == ("", "physment-eval: interrupted\n")


def test_help_needs_none_of_the_libraries_that_take_long_to_load() -> None:
    code = """
import sys
from evaluator.commands.program import main
try:
    main(["--help"])
except SystemExit:
    sys.exit(" ".join({"mcp", "pydantic", "rich", "numpy", "evaluator.records.episode"} & set(sys.modules)) or 0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "play recorded episodes again" in done.stdout


def test_commands_that_play_nothing_load_neither_mcp_nor_the_optimisers_of_scipy() -> None:
    code = """
import sys
import evaluator.commands.compare, evaluator.commands.grade, evaluator.commands.report
import evaluator.commands.scenes
sys.exit(" ".join({"mcp", "mujoco", "scipy.optimize"} & set(sys.modules)) or 0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_listed_command_is_declared_by_its_module(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: physment-eval {name} ")


@pytest.mark.parametrize("command", ["", "run", "watch", "fork", "models", "play", "compare", "scenes list"])
def test_no_line_of_a_help_text_is_longer_than_the_terminal(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 5
    assert [line for line in lines if len(line) > 80] == []

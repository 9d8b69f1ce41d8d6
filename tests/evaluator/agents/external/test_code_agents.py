"""Tests of the guide on agents that write code: the agent solves its scene, and its code is recorded."""

import re
import subprocess
import sys
from pathlib import Path

import anyio

from evaluator.agents.external.agent import parse_external
from evaluator.episode.hosts import HostConnector
from evaluator.records.episode import Episode, Outcome
from tests.builders.paths import DOCS
from tests.builders.records import VERSIONS, episode_key

PAGE = (DOCS / "how-to" / "code-agents.md").read_text(encoding="utf-8")


def files(folder: Path) -> dict[str, str]:
    """Write the files that the guide shows, and return their texts."""
    shown = dict(re.findall(r"```python file=(\w+\.py)\n(.*?)\n```\n", PAGE, re.DOTALL))
    for name, text in shown.items():
        (folder / name).write_text(f"{text}\n", encoding="utf-8")
    return shown


async def played(host: HostConnector, folder: Path) -> Episode:
    agent = parse_external([sys.executable, str(folder / "code_agent.py"), "{mcp_config}"], "host", None)
    return await agent.play(host, episode_key(agent=agent.name), VERSIONS, [])


async def test_its_code_measures_computes_and_answers_and_is_recorded(host: HostConnector, tmp_path: Path) -> None:
    assert set(files(tmp_path)) == {"interpreter.py", "code_agent.py"}
    with anyio.fail_after(300):
        episode = await played(host, tmp_path)
    assert episode.outcome is Outcome.ANSWERED, episode.error
    calls = [exchange.call.tool for turn in episode.turns for exchange in turn.exchanges]
    assert calls == ["step", "get_velocity", "step", "get_velocity", "answer"]
    said = episode.turns[-1].reasoning
    assert "second = lab('get_velocity', object_id='object_1')" in said
    assert float(re.findall(r"g = ([\d.]+)", said)[-1]) > 9
    assert abs(float(str(episode.answer)) - 7.848) < 0.1


async def test_its_code_is_told_refusals_and_survives_its_own_errors(host: HostConnector, tmp_path: Path) -> None:
    shown = files(tmp_path)
    blocks = [
        "lab('get_velocity', object_id='nothing')",
        "1 / 0",
        "import os\nprint(sorted(os.environ))\nlab('answer', answer=1)",
    ]
    before, _, rest = shown["code_agent.py"].partition("program = [")
    program = f"{before}program = {blocks!r}{rest.partition('    ]')[2]}"
    (tmp_path / "code_agent.py").write_text(program, encoding="utf-8")
    with anyio.fail_after(300):
        episode = await played(host, tmp_path)
    said = episode.turns[-1].reasoning
    assert (episode.outcome, episode.answer) == (Outcome.ANSWERED, 1), episode.error
    assert f"RuntimeError: {episode.turns[0].exchanges[0].text}" in said
    assert "ZeroDivisionError" in said
    assert "PHYSMENT" not in said


def test_the_interpreter_keeps_variables_and_ends_with_its_input(tmp_path: Path) -> None:
    files(tmp_path)
    command = [sys.executable, "-I", str(tmp_path / "interpreter.py")]
    sent = '{"code": "x = 2"}\n{"code": "print(x + 1)"}\n'
    done = subprocess.run(command, input=sent, capture_output=True, text=True, check=True)
    assert done.stdout == '{"printed": ""}\n{"printed": "3\\n"}\n'

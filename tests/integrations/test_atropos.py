"""Tests with the real Atropos: the environment of the page plays, is rewarded, and marks the tokens of its replies."""

import json
import re
from pathlib import Path

from scenes.splits import splits
from tests.builders.paths import ROOT
from tests.integrations.playing import check_same, json_lines, rehearsed, standing

PAGE = ROOT / "docs" / "how-to" / "atropos.md"
TOKENIZER = Path(__file__).parent / "programs" / "chatml_tokenizer.py"
GROUPS, EPISODES = 2, 2
BUDGET = 300
"""The scripted model makes one call in an iteration."""


def test_the_environment_of_the_page_collects_groups_as_physment_eval_plays_them(tmp_path: Path) -> None:
    program = re.search(r"```python file=physment_atropos\.py\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert program
    (tmp_path / "physment_atropos.py").write_text(program[1], encoding="utf-8")
    with standing("atropos", tmp_path) as stand:
        made = stand.run("python", TOKENIZER, tmp_path / "tokenizer")
        assert made.returncode == 0, made.stderr[-2000:]
        words = ["--env.group_size", EPISODES, "--env.use_wandb", "false", "--env.budget", BUDGET]
        words += ["--env.tokenizer_name", tmp_path / "tokenizer", "--openai.base_url", f"{stand.model}/v1"]
        words += ["--openai.model_name", "scripted"]
        collected = ["--env.total_steps", GROUPS, "--env.data_path_to_save_groups", "groups.jsonl"]
        offline = {"HF_HUB_OFFLINE": "1", "WANDB_MODE": "disabled"}
        done = stand.run("python", "physment_atropos.py", "process", *words, *collected, **offline)
        assert done.returncode == 0, done.stderr[-3000:]
        episodes = stand.folder.episodes()
        done = stand.run("python", "physment_atropos.py", "evaluate", *words, "--env.evaluated", 2, **offline)
        assert done.returncode == 0, done.stderr[-3000:]
        evaluated = stand.folder.episodes().keys() - episodes.keys()
    validation = splits()["validation"]
    assert len(evaluated) == 2
    assert all(key.scene in validation.scenes and key.seed in validation.seeds for key in evaluated)
    groups = json_lines(tmp_path / "groups.jsonl")
    assert [group["scores"] for group in groups] == [[1.0] * EPISODES] * GROUPS
    assert len(episodes) == GROUPS * EPISODES
    variants = {(key.scene, key.seed) for key in episodes}
    assert len(variants) == GROUPS
    for key, episode in episodes.items():
        check_same(episode, rehearsed(key.scene, key.seed, BUDGET))
    for group in groups:
        for tokens, masks, messages in zip(group["tokens"], group["masks"], group["messages"], strict=True):
            # The tokens of the test's tokenizer are bytes.
            trained = bytes(token for token, mask in zip(tokens, masks, strict=True) if mask != -100).decode()
            said = [message["tool_calls"][0]["function"] for message in messages if message["role"] == "assistant"]
            assert trained == "".join(f"{json.dumps(call, ensure_ascii=False)}\n" for call in said)
            assert {mask for token, mask in zip(tokens, masks, strict=True) if mask not in (-100, token)} == set()

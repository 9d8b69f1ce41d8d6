"""Tests of `model:…`: the selected model, the settings of its requests, and errors for a missing key or URL."""

import json
import subprocess
import sys
from typing import Any

import pytest

from evaluator.agents.models.choice import PRESETS, PROVIDERS, Dialect, Options, find_provider, missing, parse_model
from evaluator.agents.models.clients import settings_sent
from evaluator.errors import UsageError
from evaluator.study.run_config import model_participant

KEY = "sk-a-key-that-must-not-show"
ENVIRON = {name: KEY for provider in PROVIDERS for name in provider.key_variables}


def choose(text: str, **more: Any) -> Any:
    return parse_model(text, environ=ENVIRON, **more)


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset.name)
def test_every_preset_can_be_asked_for(preset: Any) -> None:
    agent = model_participant(f"model:{preset.name},max_tokens=9000", environ=ENVIRON)
    assert agent.name == f"model:{preset.name},max_tokens=9000"
    facts = agent.facts()
    assert (facts["provider"], facts["model"]) == (preset.provider, preset.model)
    assert "9000" in json.dumps(facts["sent"])


def test_the_seven_models_of_the_paper_are_there() -> None:
    assert [preset.title for preset in PRESETS] == [
        "GPT-5.5",
        "Gemini 3.1 Pro",
        "Claude Opus 4.7",
        "DeepSeek R1",
        "GLM-5",
        "Kimi K2.5",
        "Qwen 3.5",
    ]


def test_a_name_may_hold_colons_and_slashes() -> None:
    chosen = choose("model:ollama:qwen3:8b")
    assert (chosen.provider.name, chosen.model, chosen.base_url) == ("ollama", "qwen3:8b", "http://localhost:11434/v1")
    assert choose("model:openrouter:deepseek/deepseek-r1:free").model == "deepseek/deepseek-r1:free"


def test_options_after_the_name_win_over_options_of_all_models() -> None:
    chosen = choose("model:vllm:m,temperature=0,effort=low", options=Options("high", 1.0, 500))
    assert chosen.options == Options("low", 0.0, 500)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("model:gpt-99", "the presets are gpt-5.5"),
        ("model:nobody:m", "the providers are openai"),
        ("model:openai:", "name of the model is missing"),
        ("model:openrouter:m", "VENDOR/MODEL"),
        ("model:vllm:m,effort=heroic", "effort heroic: must be one of"),
        ("model:vllm:m,temperature=warm", "temperature must be a number"),
        ("model:vllm:m,temperature=nan", "must be from 0 to 2"),
        ("model:vllm:m,max_tokens=0", "must be 1 or more"),
        ("model:vllm:m,top_p=1", "there is no option 'top_p'"),
    ],
)
def test_an_unknown_model_or_option_is_refused_with_the_known_ones(text: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        choose(text)


@pytest.mark.parametrize("url", ["ftp://host", "host:8000", "http://", "http://[::", "http://host:99999999"])
def test_a_malformed_base_url_is_refused(url: str) -> None:
    with pytest.raises(UsageError, match="base URL"):
        choose("model:openai-compatible:m", base_url=url)


def test_the_base_url_comes_from_the_option_then_the_environment_then_the_provider() -> None:
    environ = {"PHYSMENT_BASE_URL": "http://environment/v1"}
    named = "model:openai-compatible:m"
    assert parse_model(named, environ=environ).base_url == "http://environment/v1"
    assert parse_model(named, base_url="http://option/v1", environ=environ).base_url == "http://option/v1"
    assert all(parse_model(f"model:{preset.name}", environ={}).base_url.startswith("https://") for preset in PRESETS)


def test_a_missing_key_or_url_is_reported_before_anything_is_asked() -> None:
    with pytest.raises(UsageError, match="OPENAI_API_KEY is not set; see `physment-eval models`"):
        model_participant("model:gpt-5.5", environ={})
    with pytest.raises(UsageError, match="no base URL"):
        model_participant("model:openai-compatible:m", environ={})


@pytest.mark.parametrize("text", ["model:gpt-5.5,temperature=0", "model:claude-opus-4.7,temperature=1"])
def test_an_option_that_would_be_left_out_is_refused_instead_of_recorded(text: str) -> None:
    with pytest.raises(UsageError, match=r"temperature .* would not be sent"):
        model_participant(text, environ=ENVIRON)


@pytest.mark.parametrize(
    ("text", "sent"),
    [
        ("model:gpt-5.5,effort=high", {"reasoning_effort": "high"}),
        ("model:gpt-5.5,effort=none,temperature=0.5", {"reasoning_effort": "none", "temperature": 0.5}),
        ("model:kimi-k2.5,effort=low,temperature=0", {"reasoning": {"effort": "low"}, "temperature": 0}),
        ("model:vllm:m,effort=low,max_tokens=7", {"reasoning_effort": "low", "max_tokens": 7}),
        ("model:openai:gpt-5.5,max_tokens=7", {"max_completion_tokens": 7}),
        ("model:ollama:m", {}),
    ],
)
def test_what_is_recorded_as_sent_is_what_the_client_writes(text: str, sent: dict[str, Any]) -> None:
    assert settings_sent(choose(text)) == sent


def test_providers_that_hide_thoughts_are_asked_to_show_them() -> None:
    claude = settings_sent(choose("model:claude-opus-4.7,effort=high"))
    assert claude["thinking"] == {"type": "adaptive", "display": "summarized"}
    assert claude["output_config"] == {"effort": "high"}
    gemini = settings_sent(choose("model:gemini-3.1-pro"))
    assert gemini["generationConfig"]["thinkingConfig"] == {"include_thoughts": True}


async def test_the_settings_sent_can_be_found_inside_a_running_event_loop() -> None:
    assert settings_sent(choose("model:vllm:m,temperature=0")) == {"temperature": 0}


@pytest.mark.parametrize("dialect", Dialect)
def test_neither_facts_nor_repr_hold_the_key(dialect: Dialect) -> None:
    provider = next(candidate for candidate in PROVIDERS if candidate.dialect is dialect)
    agent = model_participant(
        f"model:{provider.name}:vendor/m", base_url="http://user:word@host/v1?token=word", environ=ENVIRON
    )
    shown = f"{agent!r} {json.dumps(dict(agent.facts()))}"
    assert KEY not in shown
    assert agent.facts()["base_url"] == "http://host/v1"
    assert "word" not in json.dumps(dict(agent.facts()))


def physment_eval(*words: str, before: str = "pass", **environ: str) -> subprocess.CompletedProcess[str]:
    code = f"import sys; {before}; from evaluator.commands.program import main; sys.exit(main({list(words)!r}))"
    return subprocess.run(
        [sys.executable, "-c", code], env=environ, capture_output=True, text=True, check=False, timeout=300
    )


def test_the_command_lists_models_and_says_what_is_missing() -> None:
    done = physment_eval("models", "--json", OPENAI_API_KEY=KEY, VLLM_BASE_URL="http://user:word@gpu:8000/v1")
    said = json.loads(done.stdout)
    lacking = {preset["agent"]: preset["missing"] for preset in said["presets"]}
    assert lacking["model:gpt-5.5"] == []
    assert lacking["model:claude-opus-4.7"] == ["ANTHROPIC_API_KEY is not set"]
    places = {provider["agent"]: provider["base_url"] for provider in said["providers"]}
    assert places["model:vllm:NAME"] == "http://gpu:8000/v1"
    assert KEY not in done.stdout
    table = physment_eval("models").stdout
    assert all(f"model:{listed.name}" in table for listed in (*PRESETS, *PROVIDERS))
    assert "OPENROUTER_API_KEY is not set" in table


def test_without_the_extra_the_command_says_what_to_install() -> None:
    done = physment_eval("models", "--json", before="sys.modules['pydantic_ai'] = None")
    for provider in json.loads(done.stdout)["providers"]:
        assert "its client is not installed (pip install 'physment-mcp[models]')" in provider["missing"]


def test_the_command_line_loads_no_client_of_a_provider() -> None:
    code = (
        "import sys, evaluator.commands.program, evaluator.study.run_config;"
        "sys.exit(any(m in sys.modules for m in ('pydantic_ai', 'openai', 'anthropic', 'google.genai', 'mujoco')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=300).returncode == 0


def test_a_local_server_needs_no_key() -> None:
    provider = find_provider("ollama")
    assert provider is not None
    assert missing(provider, {}) == []

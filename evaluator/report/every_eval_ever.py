"""Exports a run as records of Every Eval Ever, the shared format for results of evaluations.

Each agent has a JSON file with its accuracies, and a JSON Lines file with its episodes. The schemas are those of
version 0.3.0, https://github.com/evaleval/every_eval_ever. Answer keys are omitted, because these records are meant to
be published.
"""

import hashlib
import json
import uuid
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, GradeRecord, Verdict
from evaluator.records.run import RunRecord
from evaluator.scores.grouping import Condition, condition
from evaluator.statistics.intervals import Proportion, proportion
from scenes import CANARY, reference_of

SCHEMA_VERSION = "0.3.0"
_NAMES = uuid.UUID("5d0c8a3e-5f0b-4c53-9a3a-3f3f6a3c7b11")
"""Namespace of the evaluation ids, so that a second export of the same run gives the same ids."""

Graded = Sequence[tuple[Episode, GradeRecord]]


class Source(NamedTuple):
    """The organization that reports the results."""

    organization: str
    relationship: str = "third_party"
    """Relation between the reporting organization and the model: `first_party`, `third_party`, `collaborative`,
    `other`."""


def every_eval_ever(run: RunRecord, graded: Graded, source: Source) -> dict[PurePosixPath, str]:
    """Return the two files of each agent by their paths in the public collection, `data/physment/DEVELOPER/MODEL/`.

    Args:
        run: Record of the run.
        graded: Its episodes with their stored grades.
        source: Who reports the results.

    Raises:
        UsageError: The time of the run is damaged.
    """
    files: dict[PurePosixPath, str] = {}
    for agent in run.plan.agents:
        pairs = [pair for pair in graded if pair[0].key.agent == agent]
        if not pairs:
            continue
        model = _model(agent, run.agents.get(agent, {}))
        key = f"{run.created_at}/{agent}"
        # A version 5 id is stable; the collection demands the form of version 4, which differs in one digit.
        name = uuid.UUID(bytes=uuid.uuid5(_NAMES, key).bytes, version=4)
        place = PurePosixPath("data", "physment", *model["id"].split("/"))
        identity = f"physment/{model['id'].replace('/', '_')}/{name}"
        rows = [_sample(identity, model["id"], episode, record) for episode, record in pairs]
        samples = "".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows)
        record = _aggregate(identity, run, model, pairs, source)
        record["detailed_evaluation_results"] = {
            "format": "jsonl",
            "file_path": str(place / f"{name}_samples.jsonl"),
            "hash_algorithm": "sha256",
            "checksum": hashlib.sha256(samples.encode()).hexdigest(),
            "total_rows": len(rows),
        }
        files[place / f"{name}.json"] = json.dumps(record, ensure_ascii=False, indent=2) + "\n"
        files[place / f"{name}_samples.jsonl"] = samples
    return files


def _model(agent: str, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return `model_info`. An agent that is no language model has the developer `physment`."""
    provider, name = str(facts.get("provider") or "physment"), str(facts.get("model") or agent)
    parts = [_slug(part) for part in (name if "/" in name else f"{provider}/{name}").split("/", 1)]
    return {
        "name": name,
        "id": "/".join(parts),
        "developer": parts[0],
        "inference_platform": provider,
        "additional_details": {
            "deployment_type": "unknown",
            "model_availability": "unknown",
            "agent": agent,
            **{key: _text(value) for key, value in facts.items() if key not in ("provider", "model")},
        },
    }


def _slug(text: str) -> str:
    """Replace characters that the name of a folder cannot contain."""
    return "".join(sign if sign.isalnum() or sign in "-._" else "-" for sign in text).strip(".") or "-"


def _aggregate(
    identity: str, run: RunRecord, model: Mapping[str, Any], pairs: Graded, source: Source
) -> dict[str, Any]:
    groups: dict[tuple[str, Condition], list[tuple[Episode, GradeRecord]]] = {}
    for episode, record in pairs:
        groups.setdefault((_dataset(episode.key), condition(episode.key)), []).append((episode, record))
    return {
        "schema_version": SCHEMA_VERSION,
        "evaluation_id": identity,
        "evaluation_timestamp": run.created_at,
        "retrieved_timestamp": _seconds(run.created_at),
        "source_metadata": {
            "source_name": "PhysMent",
            "source_type": "evaluation_run",
            "source_organization_name": source.organization,
            "evaluator_relationship": source.relationship,
        },
        "eval_library": {
            "name": "physment-eval",
            "version": run.versions.get("physment-mcp") or "unknown",
            "additional_details": {name: version for name, version in run.versions.items() if version},
        },
        "model_info": dict(model),
        "evaluation_results": [
            result for (dataset, one), group in groups.items() for result in _results(dataset, one, run, group)
        ],
    }


def _seconds(created_at: str) -> str:
    """Return a time in seconds since 1970.

    Raises:
        UsageError: The time of the run is damaged.
    """
    try:
        return str(int(datetime.fromisoformat(created_at).astimezone(UTC).timestamp()))
    except (ValueError, OverflowError) as error:
        raise UsageError(f"created_at of run.json is no time: {created_at[:40]!r}") from error


def _results(dataset: str, played: Condition, run: RunRecord, pairs: Graded) -> Iterator[dict[str, Any]]:
    """Yield the strict accuracy of a condition; nothing if none of its episodes has a verdict."""
    scored = [(one, record) for one, record in pairs if record.grade.strict is not Verdict.UNSCORED]
    if not scored:
        return
    share = proportion((one.key.scene, record.grade.strict is Verdict.CORRECT) for one, record in scored)
    plan = run.plan
    settings = {"budget": str(played.budget), "prompting": played.prompting, "protocol": played.protocol}
    settings |= {"observations": plan.observations, "presentation": ",".join(plan.presentation) or "original"}
    settings["scenes"] = "named" if plan.adaptive is None else "chosen adaptively, by the answers before"
    yield {
        "evaluation_result_id": _result_id(pairs[0][0].key),
        "evaluation_name": dataset,
        "source_data": {
            "dataset_name": dataset,
            "source_type": "other",
            "additional_details": {
                "seeds": " ".join(map(str, sorted({one.key.seed for one, _ in pairs}))),
                "packs": _text(run.packs),
            },
        },
        "metric_config": {
            "evaluation_description": "Share of episodes whose answer is right, by a tolerance of 5 % for numbers.",
            "lower_is_better": False,
            "score_type": "continuous",
            "min_score": 0.0,
            "max_score": 1.0,
        },
        "score_details": _score(share, len(pairs)),
        "generation_config": {
            "generation_args": {"max_attempts": 1, "agentic_eval_config": {"additional_details": settings}},
            "additional_details": settings,
        },
    }


def _score(share: Proportion, played: int) -> dict[str, Any]:
    return {
        "score": share.share,
        "details": {"episodes": str(played), "scored": str(share.n), "scenes": str(share.n_scenes)},
        "uncertainty": {
            "confidence_interval": {
                "lower": share.interval.low,
                "upper": share.interval.high,
                "confidence_level": 0.95,
                "method": share.method.value,
            },
            "num_samples": share.n,
        },
    }


def _dataset(key: EpisodeKey) -> str:
    """Return the collection of a scene: the suite, the open worlds, or a level of generated worlds."""
    reference = reference_of(key.scene)
    if not reference.isdecimal():
        return f"physment-{'-'.join(reference.split(':')[:2])}"
    return "physment" if key.scene < 200 else "physment-open-worlds"


def _result_id(key: EpisodeKey) -> str:
    return "/".join([_dataset(key), str(key.budget), key.prompting, key.protocol])


def _sample(identity: str, model: str, episode: Episode, record: GradeRecord) -> dict[str, Any]:
    key, grade = episode.key, record.grade
    prompt = episode.prompt
    messages = list(_messages(episode))
    answer = _text(episode.answer)
    last = max((message["turn_idx"] for message in messages if message["role"] == "assistant"), default=0)
    found = {
        "turn_idx": last,
        "source": "answer",
        "extracted_value": answer,
        "extraction_method": "tool_call",
        "is_terminal": True,
    }
    used = episode.usage
    return {
        "schema_version": SCHEMA_VERSION,
        "evaluation_id": identity,
        "model_id": model,
        "evaluation_name": _dataset(key),
        "evaluation_result_id": _result_id(key),
        "sample_id": f"{reference_of(key.scene)}/seed-{key.seed}/epoch-{key.epoch}",
        "sample_hash": hashlib.sha256(prompt.encode()).hexdigest(),
        "interaction_type": "agentic",
        "input": {"raw": prompt, "reference": []},
        "output": None,
        "messages": messages,
        "answer_attribution": [] if episode.answer is None else [found],
        "evaluation": {
            "score": float(grade.strict is Verdict.CORRECT),
            "is_correct": grade.strict is Verdict.CORRECT,
            "num_turns": max(1, len(episode.turns)),
            "tool_calls_count": sum(len(turn.exchanges) for turn in episode.turns),
        },
        "token_usage": used
        and {
            "input_tokens": used.input_tokens,
            "output_tokens": used.output_tokens,
            "total_tokens": used.input_tokens + used.output_tokens,
            "input_tokens_cache_read": used.cached_tokens,
        },
        "performance": {"latency_ms": 1000 * episode.duration_s},
        "error": episode.error,
        "metadata": {
            "outcome": episode.outcome.value,
            "verdict": grade.strict.value,
            **({} if record.law is None else {"law_equivalent": str(record.law.equivalent).lower()}),
            "pack": episode.versions.pack,
            "answer_key": "left out",
            "canary": CANARY,
        },
    }


def _messages(episode: Episode) -> Iterator[dict[str, Any]]:
    """Yield the prompt, and for each turn the reply with its calls and a message for each result."""
    yield {"turn_idx": 0, "role": "user", "content": episode.prompt}
    for number, turn in enumerate(episode.turns, start=1):
        calls = [
            {
                "id": f"turn{number}-call{place}",
                "name": exchange.call.tool,
                "arguments": {name: _text(value) for name, value in exchange.call.arguments.items()},
            }
            for place, exchange in enumerate(turn.exchanges, start=1)
        ]
        yield {"turn_idx": number, "role": "assistant", "content": turn.reasoning, "tool_calls": calls or None}
        for call, exchange in zip(calls, turn.exchanges, strict=True):
            content = exchange.text if exchange.returned else f"Not run. {exchange.text}".strip()
            yield {"turn_idx": number, "role": "tool", "content": content, "tool_call_id": [call["id"]]}
        if turn.note:
            yield {"turn_idx": number, "role": "user", "content": turn.note}


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)

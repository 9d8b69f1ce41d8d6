# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false, reportUnknownVariableType=false, reportUnknownMemberType=false
# pyright: reportUnknownParameterType=false, reportUnknownArgumentType=false
"""Writes runs as logs of Inspect AI, for its viewer and its analysis functions. One log per condition of a run."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from inspect_ai import log, model
from inspect_ai.scorer import Score
from inspect_ai.tool import ToolCall

from evaluator import (
    Episode,
    Feedback,
    Grade,
    GradeRecord,
    Outcome,
    RunRecord,
    StoreError,
    Turn,
    Usage,
    Verdict,
    feedback_text,
)
from scenes import reference_of

Graded = Sequence[tuple[Episode, GradeRecord]]
SCORER = "laboratory_grade"
"""Name of the scorer; the task uses the same name."""


def write_inspect_logs(folder: Path, run: RunRecord, graded: Graded) -> list[Path]:
    """Write a log for each combination of agent, budget, prompting and protocol in a run.

    Args:
        folder: Target folder.
        run: Record of the run.
        graded: Its episodes with their grades.

    Raises:
        StoreError: A log cannot be written.
    """
    files: list[Path] = []
    for (agent, *rest), pairs in _conditions(graded).items():
        name = re.sub(r"[^\w.]+", "-", "_".join([agent, *map(str, rest)]))
        file = folder / f"{name}.eval"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            log.write_eval_log(_log(run, agent, pairs), str(file))
        except OSError as error:
            raise StoreError(f"{file} cannot be written: {error.strerror or error}") from error
        files.append(file)
    return files


def _conditions(graded: Graded) -> Mapping[tuple[str, int, str, str], list[tuple[Episode, GradeRecord]]]:
    found: dict[tuple[str, int, str, str], list[tuple[Episode, GradeRecord]]] = {}
    for episode, record in graded:
        key = episode.key
        found.setdefault((key.agent, key.budget, key.prompting, key.protocol), []).append((episode, record))
    return found


def _log(run: RunRecord, agent: str, pairs: Graded) -> log.EvalLog:
    key = pairs[0][0].key
    samples = [_sample(episode, record) for episode, record in pairs]
    ids = list(dict.fromkeys(sample.id for sample in samples))
    condition = {"budget": key.budget, "prompting": key.prompting, "protocol": key.protocol}
    spec = log.EvalSpec(
        created=run.created_at,
        task="physment",
        task_version=run.versions.get("physment-mcp") or 0,
        task_args=condition,
        dataset=log.EvalDataset(name="physment", samples=len(ids), sample_ids=ids),
        model=agent,
        config=log.EvalConfig(epochs=max(episode.key.epoch for episode, _ in pairs)),
        packages={name: version for name, version in run.versions.items() if version and name != "platform"},
        metadata={"physment_run": run.model_dump(mode="json")},
    )
    started = [episode.started_at for episode, _ in pairs]
    return log.EvalLog(
        status="success",
        eval=spec,
        results=_results(pairs),
        stats=log.EvalStats(started_at=min(started), completed_at=max(started)),
        samples=samples,
    )


def _results(pairs: Graded) -> log.EvalResults:
    """Return the mean scores that Inspect displays.

    As in `summary.json`, episodes with an infrastructure error are excluded.
    """
    scored = [record.grade for _, record in pairs if record.grade.strict is not Verdict.UNSCORED]
    values = {
        "strict": [float(grade.strict is Verdict.CORRECT) for grade in scored],
        "normalised": [float(grade.normalised is Verdict.CORRECT) for grade in scored],
        "graded": [grade.graded or 0.0 for grade in scored],
    }
    scores = [
        log.EvalScore(
            name=name,
            scorer=SCORER,
            scored_samples=len(scored),
            unscored_samples=len(pairs) - len(scored),
            metrics={"mean": log.EvalMetric(name="mean", value=sum(numbers) / len(numbers))} if numbers else {},
        )
        for name, numbers in values.items()
    ]
    return log.EvalResults(total_samples=len(pairs), completed_samples=len(scored), scores=scores)


def _sample(episode: Episode, record: GradeRecord) -> log.EvalSample:
    key, grade = episode.key, record.grade
    messages = list(_messages(episode))
    last = next((message for message in reversed(messages) if message.role == "assistant"), None)
    scores = {}
    if grade.strict is not Verdict.UNSCORED:
        scores[SCORER] = score_of(episode, grade)
    law = {} if record.law is None else {"law_equivalent": record.law.equivalent}
    used = episode.usage
    usage = {} if used is None else {key.agent: _usage(used)}
    failed = episode.outcome is Outcome.INFRASTRUCTURE_ERROR
    return log.EvalSample(
        id=f"scene{reference_of(key.scene)}-seed{key.seed}",
        epoch=key.epoch,
        input=episode.prompt,
        target="",
        messages=messages,
        output=model.ModelOutput.from_message(last) if last is not None else model.ModelOutput(model=key.agent),
        scores=scores,
        metadata={"key": key.model_dump(), "outcome": episode.outcome.value, "pack": episode.versions.pack, **law},
        model_usage=usage,
        started_at=episode.started_at,
        total_time=episode.duration_s,
        error=log.EvalError(message=episode.error or "not played", traceback="", traceback_ansi="") if failed else None,
    )


def score_of(episode: Episode, grade: Grade) -> Score:
    """Convert the grade of an episode to a score of Inspect."""
    return Score(
        value={
            "strict": float(grade.strict is Verdict.CORRECT),
            "normalised": float(grade.normalised is Verdict.CORRECT),
            "graded": grade.graded or 0.0,
        },
        answer=None if episode.answer is None else json.dumps(episode.answer),
        explanation=grade.reason,
        metadata={"outcome": episode.outcome.value, "iterations": len(episode.turns)},
    )


def _usage(used: Usage) -> model.ModelUsage:
    # Inspect counts tokens from the cache separately; the input tokens of our records include them.
    return model.ModelUsage(
        input_tokens=used.input_tokens - used.cached_tokens,
        output_tokens=used.output_tokens,
        total_tokens=used.input_tokens + used.output_tokens,
        input_tokens_cache_read=used.cached_tokens,
    )


def _messages(episode: Episode) -> Iterator[model.ChatMessage]:
    """Convert the turns to the conversation that the agent had."""
    yield model.ChatMessageUser(content=episode.prompt)
    for number, turn in enumerate(episode.turns, start=1):
        yield from _turn(number, turn)
        if number < len(episode.turns):
            # Each result is a separate message. All other feedback is worded as in the text protocol.
            yield model.ChatMessageUser(content=feedback_text(Feedback((), turn.note, episode.allowance - number)))


def _turn(number: int, turn: Turn) -> Iterator[model.ChatMessage]:
    calls = [
        ToolCall(id=f"turn{number}-call{place}", function=exchange.call.tool, arguments=exchange.call.arguments)
        for place, exchange in enumerate(turn.exchanges, start=1)
    ]
    yield model.ChatMessageAssistant(content=turn.reasoning, tool_calls=calls or None)
    for call, exchange in zip(calls, turn.exchanges, strict=True):
        text = exchange.text if exchange.returned else f"Not run. {exchange.text}".strip()
        yield model.ChatMessageTool(content=text, tool_call_id=call.id, function=call.function)

"""Computes the state of a run at one moment, for the page of `watch`."""

import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any

from evaluator.records.episode import EpisodeKey, Outcome, Verdict, total_usage
from evaluator.records.run import RunRecord
from evaluator.scores.grouping import Condition, condition
from evaluator.statistics.intervals import proportion
from evaluator.study.shards import WHOLE, parse_shard
from evaluator.watch.followed_run import FollowedEpisode, FollowedRun

NEWEST, TROUBLED, OVERTAKEN = 25, 15, 15
"""Largest number of episodes in each list."""
RUNNING, POINTS = 50, 100
"""Largest number of running episodes, and of points of a line."""
_SILENT_S = 30.0
"""A run that has not listed its running episodes for this long counts as killed [s]."""
_PATIENCE_S = 60.0
"""A run counts as quiet if no episode ended for this long [s] and for three times its longest episode."""
_RECENT = 50
"""Number of recent episodes from which the pace is computed."""


def state_of(run: FollowedRun, now: datetime) -> dict[str, Any]:
    """Return the state of a run at a moment, as JSON values.

    Args:
        run: The run as last read.
        now: The current time in UTC, compared with the timestamps of records.
    """
    episodes = list(run.episodes.values())
    wanted = _wanted(run.record, run.episodes)
    missing = [key for key in wanted if key not in run.episodes]
    phase, quiet_s = _phase(episodes, missing, known=bool(wanted), now=now)
    pace = _pace(episodes, now)
    return {
        "name": run.folder.path.resolve().name,
        "phase": phase,
        "quiet_s": quiet_s,
        "ended": len(episodes),
        "total": len(wanted) or None,
        "left_s": len(missing) / pace if pace and missing and phase == "running" else None,
        "per_minute": None if pace is None or phase == "finished" else 60 * pace,
        "behind": run.behind,
        "withheld": run.withheld,
        "rows": list(_rows(episodes)),
        "running": [] if phase == "finished" else list(_running(run, now)),
        "course": _course(episodes),
        "report": phase == "finished" and run.folder.report_file.is_file(),
        "newest": [_shown(one, run) for one in reversed(episodes[-NEWEST:])],
        "troubled": [_shown(one, run) for one in reversed(episodes) if _is_troubled(one)][:TROUBLED],
        "overtaken": [] if phase == "finished" else _overtaken(wanted, run, now)[:OVERTAKEN],
        "notes": [*run.ungraded.values(), *_damage(run.damaged)],
    }


def _wanted(record: RunRecord, played: Mapping[EpisodeKey, object]) -> list[EpisodeKey]:
    """Return the planned episodes in playing order; empty if the plan does not determine them.

    A fork plays only some episodes of its matrix, and a referee plays whatever a trainer requests.
    """
    shard = WHOLE if record.shard is None else parse_shard(record.shard)
    wanted = [key for key in record.plan.matrix() if shard.takes(key)]
    return wanted if record.forked_from is None and played.keys() <= set(wanted) else []


def _ended_at(one: FollowedEpisode) -> float:
    """Return when an episode ended [s since 1970]."""
    return datetime.fromisoformat(one.started_at).timestamp() + one.duration_s


def _phase(
    episodes: Sequence[FollowedEpisode], missing: Sequence[EpisodeKey], *, known: bool, now: datetime
) -> tuple[str, float | None]:
    """Return `waiting`, `running`, `quiet` or `finished`, and the time since the last episode ended [s]."""
    if not episodes:
        return "waiting", None
    quiet_s = max(0.0, now.timestamp() - max(map(_ended_at, episodes)))
    if known and not missing:
        return "finished", None
    longest = max(one.duration_s for one in episodes)
    return ("quiet" if quiet_s > max(_PATIENCE_S, 3 * longest) else "running"), quiet_s


def _pace(episodes: Sequence[FollowedEpisode], now: datetime) -> float | None:
    """Return the current rate of ended episodes [1/s]; None before two episodes have ended."""
    ends = sorted(map(_ended_at, episodes))[-_RECENT:]
    if len(ends) < 2 or now.timestamp() <= ends[0]:
        return None
    return (len(ends) - 1) / (now.timestamp() - ends[0])


def _rows(episodes: Sequence[FollowedEpisode]) -> Iterator[dict[str, Any]]:
    """Yield the results of each agent under each condition, with open worlds in rows of their own."""
    groups: dict[tuple[bool, Condition], list[FollowedEpisode]] = {}
    for one in episodes:
        groups.setdefault((one.is_open, condition(one.key)), []).append(one)
    several = len({found[2:] for _, found in groups}) > 1
    for is_open, found in sorted(groups):
        group = groups[is_open, found]
        about = [found.agent, *([found.prompting, found.protocol] if several else [])]
        yield {
            "agent": ", ".join([*about, *(["open worlds"] if is_open else [])]),
            "budget": found.budget,
            **_numbers(group),
        }


def _numbers(group: Sequence[FollowedEpisode]) -> dict[str, Any]:
    verdicts = [
        (one.key.scene, one.verdict is Verdict.CORRECT)
        for one in group
        if one.verdict in {Verdict.CORRECT, Verdict.INCORRECT}
    ]
    rate = proportion(verdicts) if verdicts else None
    used = total_usage(one.usage for one in group if one.usage is not None)
    return {
        "ended": len(group),
        "scored": len(verdicts),
        "correct": sum(right for _, right in verdicts),
        "share": rate and rate.share,
        "low": rate and rate.interval.low,
        "high": rate and rate.interval.high,
        "outcomes": Counter(one.outcome.value for one in group if one.outcome is not Outcome.ANSWERED),
        "calls": statistics.median(one.cost.calls for one in group),
        "refused": sum(one.cost.refused_calls for one in group) / max(1, sum(one.cost.calls for one in group)),
        "lab_time_s": statistics.median(one.cost.lab_time_s for one in group),
        "episode_s": statistics.median(one.duration_s for one in group),
        "tokens": used and used.input_tokens + used.output_tokens,
        "cost_usd": used and used.cost_usd,
    }


def _running(run: FollowedRun, now: datetime) -> Iterator[dict[str, Any]]:
    """Yield the running episodes, longest duration first; none if the run was killed."""
    if now.timestamp() - run.running_at > _SILENT_S:
        return
    for one in sorted(run.running, key=lambda one: one.began_at)[:RUNNING]:
        began = datetime.fromisoformat(one.began_at)
        seconds = max(0.0, (now - began).total_seconds())
        yield {**_named(one.key, run), "turn": one.turn, "call": one.call, "seconds": seconds}


def _course(episodes: Sequence[FollowedEpisode]) -> list[dict[str, Any]]:
    """Return each agent's accuracy after each of its episodes, against the time since the first episode ended [s].

    If there are more than `POINTS` episodes, evenly spaced ones and the last one are returned. Open worlds are omitted.
    """
    scored = [one for one in episodes if one.verdict in {Verdict.CORRECT, Verdict.INCORRECT} and not one.is_open]
    scored.sort(key=_ended_at)
    found: dict[str, list[tuple[float, float]]] = {}
    right = Counter[str]()
    for one in scored:
        line = found.setdefault(one.key.agent, [])
        right[one.key.agent] += one.verdict is Verdict.CORRECT
        line.append((_ended_at(one) - _ended_at(scored[0]), right[one.key.agent] / (len(line) + 1)))
    return [
        {"agent": agent, "points": line[:: -(-len(line) // POINTS)] + line[-1:]}
        for agent, line in sorted(found.items())
    ]


def _is_troubled(one: FollowedEpisode) -> bool:
    """Whether an episode ended by an error, or the server refused most of its calls."""
    return (
        one.outcome in {Outcome.AGENT_ERROR, Outcome.INFRASTRUCTURE_ERROR}
        or one.cost.refused_calls > one.cost.calls / 2 > 1
    )


def _shown(one: FollowedEpisode, run: FollowedRun) -> dict[str, Any]:
    return {
        **_named(one.key, run),
        "key": one.key.model_dump_json(),
        "verdict": one.verdict,
        "outcome": one.outcome,
        "answer": one.answer,
        "error": one.error,
        "turns": one.turns,
        "calls": one.cost.calls,
        "refused": one.cost.refused_calls,
        "lab_time_s": one.cost.lab_time_s,
        "duration_s": one.duration_s,
    }


def _named(key: EpisodeKey, run: FollowedRun) -> dict[str, Any]:
    return {
        "scene": key.scene,
        "name": run.title(key.scene),
        "seed": key.seed,
        "agent": key.agent,
        "budget": key.budget,
        "epoch": key.epoch,
    }


def _overtaken(wanted: Sequence[EpisodeKey], run: FollowedRun, now: datetime) -> list[dict[str, Any]]:
    """Return unrecorded episodes that precede recorded ones of their agent; those with the most recorded ones first.

    Such an episode is still running or waits for a retry; the run folder does not say which.
    """
    found: list[dict[str, Any]] = []
    later: dict[str, list[float]] = {}
    for key in reversed(wanted):
        if key in run.episodes:
            later.setdefault(key.agent, []).append(_ended_at(run.episodes[key]))
        elif later.get(key.agent):
            ends = later[key.agent]
            found.append({**_named(key, run), "by": len(ends), "since_s": max(0.0, now.timestamp() - min(ends))})
    return sorted(found, key=lambda one: -one["by"])


def _damage(lines: int) -> list[str]:
    return (
        [f"{lines} lines of episodes.jsonl are damaged and left out; `run --resume` sets them aside"] if lines else []
    )

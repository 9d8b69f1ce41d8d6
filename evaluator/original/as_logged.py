"""Converts published logs to episode records with the results that the models read. Knows no laboratory or verdicts.

Playing a log again gives results of our laboratory, which the model never saw. Only the results in the log can show
whether a number in a reply was read or invented.
"""

import json
import re
from collections.abc import Sequence
from typing import Any

from pydantic import JsonValue

from evaluator.episode.player import ANSWER
from evaluator.episode.protocols.text import parse_reply
from evaluator.original.logs import LoggedEpisode
from evaluator.records.episode import UNREAD, Episode, EpisodeKey, Exchange, Outcome, ToolCall, Turn, Versions

_RETURN = re.compile(r"^([A-Za-z_]\w*)\((.*?)\) -> (.*)$", re.MULTILINE)
_TIME = re.compile(r"^\[sim_time=([0-9.eE+-]+)\]", re.MULTILINE)
_ERROR = "ERROR: "


def as_logged(log: LoggedEpisode, key: EpisodeKey, versions: Versions) -> Episode:
    """The episode recorded in a log.

    The result of a call is the next line of the following prompt that names its tool. A call without such a line did
    not run; this includes all calls of a reply that the authors' program could not parse. A reply with several sets of
    calls, of which that program ran the first, has no calls here. Calls before the answer in
    the last batch ran, but nobody saw their results. The log gives the simulated time once after each batch; here it is
    added to the result of the batch's last successful call.

    Args:
        log: The log, with at least one reply.
        key: The key under which the episode is stored.
        versions: Versions to record; the pack's version is that of the pack used for grading.
    """
    last = len(log.replies) - 1
    turns = [_turn(reply, _next_prompt(log, index), is_last=index == last) for index, reply in enumerate(log.replies)]
    calls = [exchange.call for exchange in turns[-1].exchanges]
    answers = [call.arguments.get("answer") for call in calls if call.tool == ANSWER]
    answered = bool(answers) and answers[-1] is not None
    used_up = len(turns) >= key.budget
    return Episode(
        key=key,
        outcome=Outcome.ANSWERED if answered else Outcome.BUDGET_EXHAUSTED if used_up else Outcome.AGENT_ERROR,
        answer=answers[-1] if answered else None,
        prompt=log.prompts[0],
        turns=tuple(turns),
        error=None if answered or used_up else "the log ends here",
        started_at="",
        duration_s=0,
        versions=versions,
    )


def _next_prompt(log: LoggedEpisode, index: int) -> str:
    return log.prompts[index + 1] if index + 1 < len(log.prompts) else ""


def _turn(text: str, results: str, *, is_last: bool) -> Turn:
    reply = parse_reply(text)
    lines = _RETURN.findall(results)
    exchanges: list[Exchange] = []
    for call in reply.calls:
        if call.tool == ANSWER:
            # If their program continued after an answer, it had not accepted the answer.
            exchanges.append(Exchange(call=call, returned=is_last))
        elif lines and lines[0][0] == call.tool:
            exchanges.append(_exchange(call, lines.pop(0)[2]))
        else:
            answers = any(other.tool == ANSWER for other in reply.calls)
            exchanges.append(Exchange(call=call, returned=is_last and answers))
    time = _TIME.search(results)
    note = f"{UNREAD}: {reply.malformed}" if reply.malformed else "" if exchanges else "no call"
    return Turn(reasoning=reply.reasoning, exchanges=_timed(exchanges, time and time[1]), note=note)


def _exchange(call: ToolCall, result: str) -> Exchange:
    if result.startswith(_ERROR):
        return Exchange(call=call, returned=True, is_error=True, text=result.removeprefix(_ERROR))
    return Exchange(call=call, returned=True, content=_content(result), text=result)


def _content(result: str) -> dict[str, Any]:
    """A result as a JSON object; any other value, such as `ok` or a list, is put under the key `result`."""
    try:
        value: JsonValue = json.loads(result, parse_constant=lambda _: None)
    except ValueError:
        value = result
    return value if isinstance(value, dict) else {"result": value}


def _timed(exchanges: Sequence[Exchange], time: str | None) -> tuple[Exchange, ...]:
    """The exchanges of a batch, with the simulated time [s] added to the last successful one."""
    last = next((i for i in reversed(range(len(exchanges))) if exchanges[i].content is not None), None)
    if time is None or last is None:
        return tuple(exchanges)
    content = {**(exchanges[last].content or {}), "sim_time": float(time)}
    return (*exchanges[:last], exchanges[last].model_copy(update={"content": content}), *exchanges[last + 1 :])

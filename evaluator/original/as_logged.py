"""Published logs as records of what happened there: the models' calls with the returns that *they* read.

Playing a log again gives the returns of our laboratory, to which the model never replied. Whether a number in a reply
was read or made up can only be asked of the returns in the log. Knows no laboratory and no verdicts.
"""

import json
import re
from collections.abc import Sequence
from typing import Any

from pydantic import JsonValue

from evaluator.episode.player import ANSWER
from evaluator.original.logs import LoggedEpisode
from evaluator.protocols.text import parse_reply
from evaluator.records import Episode, EpisodeKey, Exchange, Outcome, ToolCall, Turn, Versions

_RETURN = re.compile(r"^([A-Za-z_]\w*)\((.*?)\) -> (.*)$", re.MULTILINE)
_TIME = re.compile(r"^\[sim_time=([0-9.eE+-]+)\]", re.MULTILINE)
_ERROR = "ERROR: "


def as_logged(log: LoggedEpisode, key: EpisodeKey, versions: Versions) -> Episode:
    """The episode that a log tells of.

    A call is matched with the next line of the following prompt that names its tool. What has no such line was not run,
    as are those of a reply that the authors' program could not read. Calls before the answer in the last batch ran, but
    what they returned was told to nobody. The simulated time, told once after each batch, stands in the return of its
    last call that succeeded.

    Args:
        log: The log; it holds a reply at least.
        key: What the episode is kept under.
        versions: Versions to record: those of the pack it is graded with.
    """
    last = len(log.replies) - 1
    turns = [_turn(reply, _read_next(log, index), is_last=index == last) for index, reply in enumerate(log.replies)]
    answers = [one.call.arguments.get("answer") for one in turns[-1].exchanges if one.call.tool == ANSWER]
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


def _read_next(log: LoggedEpisode, index: int) -> str:
    return log.prompts[index + 1] if index + 1 < len(log.prompts) else ""


def _turn(text: str, told: str, *, is_last: bool) -> Turn:
    reply = parse_reply(text)
    lines = _RETURN.findall(told)
    exchanges: list[Exchange] = []
    for call in reply.calls:
        if call.tool == ANSWER:
            # An answer that their program went on after was not taken.
            exchanges.append(Exchange(call=call, returned=is_last))
        elif lines and lines[0][0] == call.tool:
            exchanges.append(_exchange(call, lines.pop(0)[2]))
        else:
            exchanges.append(Exchange(call=call, returned=is_last and any(one.tool == ANSWER for one in reply.calls)))
    time = _TIME.search(told)
    note = reply.malformed or ("" if exchanges else "no call")
    return Turn(reasoning=reply.reasoning, exchanges=_timed(exchanges, time and time[1]), note=note)


def _exchange(call: ToolCall, said: str) -> Exchange:
    if said.startswith(_ERROR):
        return Exchange(call=call, returned=True, is_error=True, text=said.removeprefix(_ERROR))
    return Exchange(call=call, returned=True, content=_content(said), text=said)


def _content(said: str) -> dict[str, Any]:
    """A return as an object; what is none, such as `ok` or a list, stands under `result`."""
    try:
        value: JsonValue = json.loads(said, parse_constant=lambda _: None)
    except ValueError:
        value = said
    return value if isinstance(value, dict) else {"result": value}


def _timed(exchanges: Sequence[Exchange], time: str | None) -> tuple[Exchange, ...]:
    """The exchanges of a batch, the last that succeeded with the simulated time after it [s]."""
    last = next((i for i in reversed(range(len(exchanges))) if exchanges[i].content is not None), None)
    if time is None or last is None:
        return tuple(exchanges)
    content = {**(exchanges[last].content or {}), "sim_time": float(time)}
    return (*exchanges[:last], exchanges[last].model_copy(update={"content": content}), *exchanges[last + 1 :])

"""Small runs for the tests of the report, with everything that a notebook shows."""

from evaluator.failures.findings import Evidence, Failure, FailureMode
from evaluator.records import (
    Episode,
    EpisodeKey,
    Exchange,
    Grade,
    Outcome,
    Plan,
    RunRecord,
    ServerRecord,
    ToolCall,
    Turn,
    Usage,
    Verdict,
    Versions,
)
from evaluator.report.agent_results import Run
from evaluator.scores.scored_episode import ScoredEpisode
from tests.builders.scored import scored

RECORD = RunRecord(
    created_at="2026-01-01T00:00:00+00:00",
    plan=Plan(scenes=(7, 8), agents=("model:x", "reference"), budgets=(5, 20)),
    server=ServerRecord(option="host"),
    packs={"7": "abc", "8": "def"},
)
CATEGORIES = ("easy-single", "easy-multi-hidden", "hard-single", "hard-multi")
PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00\x01\x00\x00\x00\x01\x08\x06\x00\x00\x00\x1f\x15\xc4\x89"


def fall(time: float, height: float) -> tuple[Exchange, ...]:
    """A step of the simulation and a reading of the ball's position."""
    step, look = (
        ToolCall(tool="step", arguments={"duration": 0.1}),
        ToolCall(tool="get_position", arguments={"object_id": 1}),
    )
    content = {"sim_time": time, "position": [0.0, 0.0, height]}
    return (
        Exchange(call=step, returned=True, content={"sim_time": time, "steps": 50}, text="{}"),
        Exchange(call=look, returned=True, content=content, text=f'{{"position": [0.0, 0.0, {height}]}}'),
    )


def played(scene: int, agent: str, budget: int, *, right: bool, seed: int = 0) -> ScoredEpisode:
    """An episode of a falling ball."""
    turns = (
        Turn(reasoning="I let it fall.", exchanges=fall(0.1, 1.951), agent_s=2.0, server_s=0.01),
        Turn(reasoning="It is at 1.951 m, and its mass is 55.3 kg.", exchanges=fall(0.2, 1.804), agent_s=3.0),
    )
    episode = Episode(
        key=EpisodeKey(scene=scene, seed=seed, agent=agent, budget=budget),
        outcome=Outcome.ANSWERED,
        answer=1.5 if right else "no idea",
        prompt="Where is the ball?",
        turns=turns,
        usage=Usage(input_tokens=1000, output_tokens=200, cost_usd=0.01) if agent.startswith("model") else None,
        started_at="2026-01-01T00:00:00+00:00",
        duration_s=5.0,
        versions=Versions(physment="0", protocol="0", pack="0"),
    )
    verdict = Verdict.CORRECT if right else Verdict.INCORRECT
    found = Failure(
        mode=FailureMode.ANSWER_FORMAT,
        explanation="It answered in words.",
        evidence=(Evidence(turn=1, exchange=1, quote="no idea", numbers={"simulated_s": 0.2}),),
    )
    return scored(
        episode,
        Grade(strict=verdict, graded=float(right), normalised=verdict, reason="as read" if right else "no number"),
        CATEGORIES[scene % len(CATEGORIES)],
        "calculation" if scene % 2 else "comparison",
        failures=() if right else (found,),
    )


def run_of(rows: list[ScoredEpisode], name: str = "study") -> Run:
    return Run(name, RECORD, rows, {7: PNG})

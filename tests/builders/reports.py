"""Small runs for tests of the report. They contain every kind of event that a notebook shows."""

from evaluator.records.episode import Exchange, Usage
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.report.agent_results import Run
from evaluator.scores.failures.findings import Evidence, Failure, FailureMode
from evaluator.scores.scored_episode import ScoredEpisode
from tests.builders.records import episode, episode_key, grade, returned, turn
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
    """Let time pass, and read where the ball is."""
    position = [0.0, 0.0, height]
    return (
        returned("step", {"sim_time": time, "steps": 50}, duration=0.1),
        returned("get_position", {"sim_time": time, "position": position}, object_id=1),
    )


def played(scene: int, agent: str, budget: int, *, right: bool, seed: int = 0) -> ScoredEpisode:
    """An episode of a falling ball."""
    done = episode(
        turn("I let it fall.", *fall(0.1, 1.951)).model_copy(update={"agent_s": 2.0, "server_s": 0.01}),
        turn("It is at 1.951 m, and its mass is 55.3 kg.", *fall(0.2, 1.804)).model_copy(update={"agent_s": 3.0}),
        key=episode_key(scene, seed=seed, agent=agent, budget=budget),
        answer=1.5 if right else "no idea",
        prompt="Where is the ball?",
        usage=Usage(input_tokens=1000, output_tokens=200, cost_usd=0.01) if agent.startswith("model") else None,
    )
    found = Failure(
        mode=FailureMode.ANSWER_FORMAT,
        explanation="It answered in words.",
        evidence=(Evidence(turn=1, exchange=1, quote="no idea", numbers={"simulated_s": 0.2}),),
    )
    return scored(
        done.model_copy(update={"duration_s": 5.0}),
        grade(right, reason="as read" if right else "no number"),
        CATEGORIES[scene % len(CATEGORIES)],
        "calculation" if scene % 2 else "comparison",
        failures=() if right else (found,),
    )


def run_of(rows: list[ScoredEpisode], name: str = "study") -> Run:

    return Run(name, RECORD, rows, {7: PNG})

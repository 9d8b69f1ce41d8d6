"""Tasks for verifiers: episodes of the laboratory that a referee opens and grades."""

import asyncio
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import verifiers.v1 as vf
from physment_harness import LaboratoryState, PhysmentHarness, PhysmentHarnessConfig
from physment_referee import (
    TOKEN_VARIABLE,
    URL,
    URL_VARIABLE,
    OpenedEpisode,
    Referee,
    RefereeError,
    name_of,
    read_variants,
)
from pydantic import Field


class PhysmentData(vf.TaskData):
    """The variant of the episode, as requested from the referee."""

    scene: int | None = None
    seed: int | None = None
    world: dict[str, Any] | None = None
    split: str | None = None
    index: int | None = None
    random_seed: int | None = None
    curriculum: str | None = None

    @property
    def variant(self) -> dict[str, Any]:
        """The variant, as the arguments of `Referee.open`."""
        return self.model_dump(include=set(PhysmentData.__annotations__), exclude_none=True)


class PhysmentTaskConfig(vf.TaskConfig):
    """Settings for opening episodes: `--env.taskset.task.*`."""

    referee: str = Field(default_factory=lambda: os.environ.get(URL_VARIABLE) or URL)
    """Address of `physment-eval referee`; the variable PHYSMENT_REFEREE_URL by default."""
    budget: int = Field(20, ge=1, le=1000)
    """Iterations: turns of the model."""
    prompting: Literal["zero-shot", "one-shot-cot", "few-shot-cot"] = "zero-shot"


class PhysmentTask(vf.Task[PhysmentData, LaboratoryState, PhysmentTaskConfig]):
    """One episode: the referee opens it before the first turn and grades it after the last."""

    _checked: OpenedEpisode | None = None
    """The episode that `setup` opened last; `validate` closes it, because no model plays it."""

    @property
    def key(self) -> str:
        """Name of the variant, the same in every run."""
        return name_of(self.data.variant)

    async def setup(self, trace: vf.Trace) -> None:
        """Open the episode."""
        config = self.config
        opened = await self._opened(**self.data.variant, budget=config.budget, prompting=config.prompting)
        self._checked = opened
        state = trace.state
        state.episode_id, state.owner_token = opened.episode_id, opened.owner_token
        state.mcp_url, state.player_token = opened.mcp_url, opened.player_token
        state.prompt = opened.prompt
        state.tools = [_described(tool) for tool in opened.tools]
        trace.info["physment"] = {
            "scene": opened.scene,
            "world": opened.world,
            "split": opened.split,
            "index": opened.index,
        }

    @vf.stop
    async def answered(self, trace: vf.Trace) -> bool:
        """Return whether the laboratory accepted an answer."""
        return trace.state.answered

    @vf.stop
    async def budget_exhausted(self, trace: vf.Trace) -> bool:
        """Return whether the iterations are used up."""
        return trace.num_turns >= self.config.budget

    @vf.reward(weight=1.0)
    async def laboratory(self, trace: vf.Trace) -> float:
        """Return the referee's reward of the episode. Records verdicts and calls as metrics."""
        state = trace.state
        found = await asyncio.to_thread(
            self._referee().reward,
            state.episode_id,
            state.owner_token,
            iterations=trace.num_turns,
            end="budget_exhausted",
        )
        trace.info["physment"] |= {"outcome": found.outcome, "strict": found.strict, "normalised": found.normalised}
        trace.record_metric("strict", float(found.strict == "correct"))
        trace.record_metric("graded", found.graded)
        trace.record_metric("calls", float(found.calls))
        return found.reward

    async def validate(self, runtime: vf.Runtime) -> bool:
        """Return whether the reference protocol solves this variant. Its open episode is closed: no model plays it."""
        del runtime
        if self._checked is not None:
            await asyncio.to_thread(self._referee().close, self._checked.episode_id, self._checked.owner_token)
        found = await asyncio.to_thread(self._referee().check, **self.data.variant)
        return found.strict == "correct"

    async def _opened(self, **wanted: Any) -> OpenedEpisode:
        """Open an episode. While the referee is at its limit of open episodes, wait and retry."""
        while True:
            try:
                return await asyncio.to_thread(self._referee().open, **wanted)
            except RefereeError as error:
                if error.retry_after_s is None:
                    raise
                await asyncio.sleep(error.retry_after_s)

    def _referee(self) -> Referee:
        return Referee(self.config.referee, os.environ.get(TOKEN_VARIABLE) or None)


def _described(tool: dict[str, Any]) -> dict[str, Any]:
    """A tool as chat completions describe it."""
    function = {"name": tool["name"], "description": tool["description"], "parameters": tool["input_schema"]}
    return {"type": "function", "function": function}


class PhysmentConfig(vf.TasksetConfig):
    """The selection of episodes: `--env.taskset.*`."""

    scenes: str = ""
    """Ids and ranges such as `7,21-30`; 7 if nothing names a variant."""
    seeds: str = ""
    """Seeds and ranges of seeds (default 1); every scene is played with every seed."""
    split: str = ""
    """A split, such as `train`; the options that follow select its variants."""
    levels: str = ""
    """Levels of generated worlds, such as `1-3`, instead of scenes; the options that follow select worlds of each."""
    indices: str = ""
    """Indices in the split or the level, such as `0-99`."""
    random_seeds: str = ""
    """Numbers such as `1-100`, each of which draws an index in the split or the level."""
    curriculum: str = ""
    """Name of a curriculum of the referee, on the split or on worlds; `random_seeds` then draw variants from it."""
    pairs: Path | None = None
    """A file with a line such as {"scene": 7, "seed": 3} or {"split": "train", "index": 0} for each episode. With a
    file, the options above are ignored."""
    task: PhysmentTaskConfig = PhysmentTaskConfig()


class PhysmentTaskset(vf.Taskset[PhysmentTask, PhysmentConfig]):
    """Variants: pairs of a scene and a seed, indices in a split or among worlds, or choices of a curriculum."""

    def load(self) -> Iterator[PhysmentTask]:
        """Return the tasks. The laboratory writes their prompts when they are set up."""
        config = self.config
        named = read_variants(
            config.scenes or ("" if config.split or config.levels or config.curriculum else "7"),
            config.seeds,
            config.pairs,
            split=config.split,
            levels=config.levels,
            indices=config.indices,
            random_seeds=config.random_seeds,
            curriculum=config.curriculum,
        )
        for variant in named:
            yield PhysmentTask(PhysmentData(name=name_of(variant), prompt=None, **variant), config.task)


class PhysmentEnvConfig(vf.EnvConfig):
    """The environment's single agent."""

    agent: vf.AgentConfig = vf.AgentConfig(harness=PhysmentHarnessConfig(), runtime=vf.SubprocessConfig())
    """The chat loop of this package, which alone offers the tools of the laboratory."""


class PhysmentEnv(vf.Env[PhysmentEnvConfig]):
    """Plays as `physment-eval` does: a reply without a call uses an iteration but does not end the episode."""

    async def run(self, task: vf.Task, agents: vf.Agents) -> None:
        """Play one episode.

        Raises:
            ValueError: Another harness was chosen.
        """
        if not isinstance(agents.agent.harness, PhysmentHarness):
            raise ValueError("only the harness `physment-harness` offers the tools of the laboratory: name no other")  # noqa: TRY004 - a wrong option
        async with agents.agent.interaction(task) as interaction:
            trace = interaction.trace
            segment = await interaction.turn(trace.state.prompt)
            while not segment.terminated:
                left = task.config.budget - trace.num_turns
                segment = await interaction.turn(f"Your reply held no tool call.\n\nIterations left: {left}.")

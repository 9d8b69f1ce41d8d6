"""Episodes of the laboratory as tasks: opened and graded by a referee, played over MCP, ended by the answer."""

import asyncio
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import verifiers.v1 as vf
from physment_referee import TOKEN_VARIABLE, URL, URL_VARIABLE, OpenedEpisode, Referee, read_pairs
from pydantic import Field
from verifiers.v1.harnesses.null.harness import NullHarnessConfig

from physment.toolset import LaboratoryState, LaboratoryToolset


class PhysmentData(vf.TaskData):
    """Which episode."""

    scene: int
    seed: int


class PhysmentTaskConfig(vf.TaskConfig):
    """How episodes are opened: `--env.taskset.task.*`."""

    referee: str = Field(default_factory=lambda: os.environ.get(URL_VARIABLE) or URL)
    """Address of `physment-eval referee`; the variable PHYSMENT_REFEREE_URL by default."""
    budget: int = Field(20, ge=1, le=1000)
    """Iterations: turns of the model."""
    prompting: Literal["zero-shot", "one-shot-cot", "few-shot-cot"] = "zero-shot"


class PhysmentTask(vf.Task[PhysmentData, LaboratoryState, PhysmentTaskConfig]):
    """One episode: the referee opens it before the first turn and grades it after the last."""

    _checked: OpenedEpisode | None = None
    """The episode that was opened last, for checks that nobody plays."""

    @property
    def key(self) -> str:
        """Names the pair: the same in every run."""
        return f"scene{self.data.scene}-seed{self.data.seed}"

    async def setup(self, trace: vf.Trace) -> None:
        """Open the episode."""
        config = self.config
        opened = await asyncio.to_thread(
            self._referee().open, self.data.scene, self.data.seed, budget=config.budget, prompting=config.prompting
        )
        self._checked = opened
        state = trace.state
        state.episode_id, state.owner_token = opened.episode_id, opened.owner_token
        state.mcp_url, state.player_token = opened.mcp_url, opened.player_token
        state.prompt = opened.prompt

    @vf.stop
    async def answered(self, trace: vf.Trace) -> bool:
        """The laboratory accepted an answer."""
        return trace.state.answered

    @vf.stop
    async def budget_exhausted(self, trace: vf.Trace) -> bool:
        """The iterations are used up."""
        return trace.num_turns >= self.config.budget

    @vf.reward(weight=1.0)
    async def laboratory(self, trace: vf.Trace) -> float:
        """What the episode is worth to the referee. Records verdicts and calls as metrics."""
        state = trace.state
        found = await asyncio.to_thread(
            self._referee().reward,
            state.episode_id,
            state.owner_token,
            iterations=trace.num_turns,
            end="budget_exhausted",
        )
        trace.info["physment"] = {"outcome": found.outcome, "strict": found.strict, "normalised": found.normalised}
        trace.record_metric("strict", float(found.strict == "correct"))
        trace.record_metric("graded", found.graded)
        trace.record_metric("calls", float(found.calls))
        return found.reward

    async def validate(self, runtime: vf.Runtime) -> bool:
        """Whether the reference protocol of the scene solves this variant. No model plays, so the episode is closed."""
        del runtime
        if self._checked is not None:
            await asyncio.to_thread(self._referee().close, self._checked.episode_id, self._checked.owner_token)
        found = await asyncio.to_thread(self._referee().check, self.data.scene, self.data.seed)
        return found.strict == "correct"

    def _referee(self) -> Referee:
        return Referee(self.config.referee, os.environ.get(TOKEN_VARIABLE) or None)


class PhysmentConfig(vf.TasksetConfig):
    """Which episodes: `--env.taskset.*`."""

    scenes: str = "7"
    """Ids and ranges such as `7,21-30`."""
    seeds: str = "1"
    """Ids and ranges of seeds; every scene comes with each."""
    pairs: Path | None = None
    """A file with a line such as {"scene": 7, "seed": 3} for each episode, instead of both."""
    tools: vf.SharedToolsetConfig = vf.SharedToolsetConfig()
    task: PhysmentTaskConfig = PhysmentTaskConfig()


class PhysmentTaskset(vf.Taskset[PhysmentTask, PhysmentConfig]):
    """Pairs of a scene and a seed."""

    @classmethod
    def toolsets(cls, config: PhysmentConfig) -> list[vf.Toolset]:
        """One server for all rollouts of a worker."""
        return [LaboratoryToolset(config.tools)]

    def load(self) -> Iterator[PhysmentTask]:
        """The tasks. The laboratory writes their prompts when they are set up."""
        for scene, seed in read_pairs(self.config.scenes, self.config.seeds, self.config.pairs):
            data = PhysmentData(name=f"scene{scene}-seed{seed}", prompt=None, scene=scene, seed=seed)
            yield PhysmentTask(data, self.config.task)


class PhysmentEnvConfig(vf.EnvConfig):
    """The one seat."""

    agent: vf.AgentConfig = vf.AgentConfig(harness=NullHarnessConfig(id="null"), runtime=vf.SubprocessConfig())
    """A chat program with no tools of its own, in a process of this machine."""


class PhysmentEnv(vf.Env[PhysmentEnvConfig]):
    """An episode as `physment-eval` plays it: a reply without a call costs its iteration and does not end it."""

    async def run(self, task: vf.Task, agents: vf.Agents) -> None:
        """Play one episode."""
        async with agents.agent.interaction(task) as interaction:
            trace = interaction.trace
            segment = await interaction.turn(trace.state.prompt)
            while not segment.terminated:
                left = task.config.budget - trace.num_turns
                segment = await interaction.turn(f"Your reply held no tool call.\n\nIterations left: {left}.")

"""The configuration of a run, built from the command line, a study file or Python."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from evaluator.agents.external.agent import ExternalAgent
from evaluator.agents.models.choice import Options
from evaluator.agents.models.lanes import Patience
from evaluator.agents.presentation import Change
from evaluator.episode.loop import Participant
from evaluator.records.run import Plan
from evaluator.records.seed_key import SeedKey, SeedOf, seed_as_recorded
from evaluator.study.meter import Limits
from evaluator.study.shards import WHOLE, Shard
from scenes import PackFiles


@dataclass(frozen=True, slots=True, kw_only=True)
class RunConfig:
    """The configuration of a run. It can be pickled, and creates the same agents on every machine."""

    # Who plays
    agents: tuple[str, ...] = ("reference",)
    """Value of each `--agent`."""
    server: str = "stdio"
    """Value of `--server`."""
    scenes_dir: Path | None = None
    """Folder of scene packs; None for the suite."""
    observations: str = "text"
    """`text`, or `rgb` for results with images."""
    model_options: Options = field(default_factory=Options)
    """Options of all models."""
    base_url: str | None = None
    """Base URL of the models' API, instead of the provider's own."""
    lanes: Mapping[str, int] = field(default_factory=dict[str, int])
    """Provider → largest number of concurrent requests."""
    patience: Patience = field(default_factory=Patience)
    """Timeouts and number of retries of requests to models."""
    stopping: str = "always"
    """Value of `--stopping`: the policy that advises agents when to answer."""
    presentation: tuple[Change, ...] = ()
    """Changes of the presentation that agents receive; see `evaluator.agents.presentation`."""
    command: tuple[str, ...] = ()
    """Arguments after `--`: the program of an external agent."""
    max_calls: int | None = None
    """Largest number of tool calls of an external agent in an episode."""
    max_wall_s: float = 1800.0
    """Time limit of an external agent for an episode, as wall time [s]."""
    home: Path | None = None
    """Template folder that is copied to the home directory of an external agent."""
    sealed: bool = False
    """Whether the operator declares that an external agent cannot read the packs."""
    users: tuple[str, ...] = ()
    """System users that a sealed agent runs as."""
    seed_key: SeedKey | None = None
    """The key of held-back seeds; None if the seeds are as recorded."""

    # The matrix
    packs: tuple[PackFiles, ...] = ()
    split: str = ""
    """Name and version of the split of scenes and seeds; empty if none was named."""
    budgets: tuple[int, ...] = (20,)
    seeds: tuple[int, ...] = (0,)
    spare_seeds: range = range(0)
    """Seeds that may replace a seed that fails its checks; empty if the operator named the seeds."""
    unproved: bool = False
    """Whether seeds that no certificate covers are played without checking them."""
    epochs: int = 1
    same_seeds: bool = False
    """Whether external agents get the same seeds at each repetition, as other agents do."""
    promptings: tuple[str, ...] = ("zero-shot",)
    protocols: tuple[str, ...] = ("native",)
    adaptive: float | None = None
    """Standard error of the ability at which an adaptive test ends [logits]; None to play the whole matrix."""
    difficulties: Path | None = None
    """`calibration.json` with the difficulties for an adaptive test; None for the one that ships."""
    shard: Shard = WHOLE
    """The part of the matrix that this process plays."""

    # Execution
    limits: Limits = field(default_factory=Limits)
    concurrency: int = 1
    """Number of episodes played at a time."""
    executor: str = "local"
    """`local` or `ray`."""
    workers: int | None = None
    """Number of worker processes; None for the default of `usual_workers`."""
    episode_timeout_s: float | None = 7200.0
    """Time limit of one attempt at an episode, as wall time [s]; None for no limit."""
    out: Path | None = None
    """Run folder, or parent folder of the shards; None for a new folder below `runs`."""
    resume: bool = False
    allow_modified: bool = False
    """Whether to accept records that do not match their seal."""
    dry_run: bool = False
    otel: bool = False
    """Whether to export OpenTelemetry spans."""
    as_json: bool = False
    """Whether to print the summary to stdout as JSON, and everything else to stderr."""

    @property
    def seed_of(self) -> SeedOf:
        """The function that maps the seed in an episode's key to the seed from which its hidden values are sampled."""
        return seed_as_recorded if self.seed_key is None else self.seed_key.seed

    def plan(self, participants: Mapping[str, Participant]) -> Plan:
        """The matrix of the run.

        Args:
            participants: Name → participant.
        """
        programs = tuple(name for name, participant in participants.items() if isinstance(participant, ExternalAgent))
        return Plan(
            scenes=tuple(files.scene_id for files in self.packs),
            agents=tuple(participants),
            budgets=self.budgets,
            seeds=self.seeds,
            epochs=self.epochs,
            promptings=self.promptings,
            protocols=self.protocols,
            observations=self.observations,
            own_seeds=() if self.same_seeds else programs,
            split=self.split,
            presentation=tuple(map(str, self.presentation)),
            held_back=self.seed_key.commitment if self.seed_key else "",
        )

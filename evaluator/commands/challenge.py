"""`physment-eval challenge`: a class or a study, in which many people solve scenes in their browsers at once."""

import argparse
import contextlib
import socket
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import anyio
from rich.console import Console

from evaluator.agents.browser.app import app
from evaluator.answers.keys import KeyRing
from evaluator.calibration.adaptive import DIFFICULTIES, DifficultyTable, read_difficulties
from evaluator.commands.adaptive import of_known_difficulty
from evaluator.commands.base import Commands, count_of, folder_to_write, listening, logits, port, run_async
from evaluator.commands.challenge_people import (
    MOST_PEOPLE,
    Challenge,
    Person,
    read_challenge,
    remove_person,
    with_tokens,
    write_challenge,
    write_links,
)
from evaluator.commands.challenge_session import AGENT, RunningChallenge, remaining_of
from evaluator.commands.finishing import finish
from evaluator.commands.human_episode import kept_if_used, serving
from evaluator.episode.connect import connect
from evaluator.episode.toolbox import shows_views
from evaluator.errors import InfrastructureError, UsageError
from evaluator.records.run import AdaptivePlan, Plan, RunRecord, ServerRecord
from evaluator.scores.scoring import strict_verdict
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import played_worlds
from evaluator.study.run_start import continued, run_record, server_record
from evaluator.study.selection import parse_numbers, parse_scenes
from scenes import PackFiles, find_pack

_DESCRIPTION = """\
Let a class or the people of a study solve scenes in their browsers, all at once. Each person gets a secret link and a
code, and no name is asked for. Everyone agrees to one sentence before anything is recorded.

  physment-eval challenge runs/class --people 20 --scenes 7,9,21 --minutes 45
  physment-eval challenge runs/study --people 60 --adaptive 0.5 --seeds 0-19
  physment-eval challenge runs/class                go on with the same people after a stop
  physment-eval challenge runs/class --forget 07    delete everything that the person with this code did

The links are in DIR-links.csv, beside the run folder. The pages are for this machine alone; to let others in, put a
proxy with TLS before them, on this machine, and name it by --public-address. Ctrl-C ends the challenge and writes the
report. The run folder is an ordinary one, of the agent `human`; each person is a repetition (epoch) in it.
"""
_LINGER_S = 3.0
"""Time for which the server keeps running at the end, so that open pages can show it [s]."""
_SETTINGS = ("people", "scenes", "adaptive", "seeds", "budget", "minutes", "feedback", "organiser")
"""Options that cannot be changed once people have links."""


def add(commands: Commands) -> None:
    """Declare the command `challenge` and its options."""
    command = commands.add_parser(
        "challenge", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    command.set_defaults(run=_challenge)
    command.add_argument("folder", type=folder_to_write, metavar="DIR", help="run folder")
    command.add_argument(
        "--people", type=count_of("people"), metavar="N", help=f"number of people, up to {MOST_PEOPLE}"
    )
    command.add_argument("--scenes", metavar="LIST", help="scenes, as in run, in this order")
    command.add_argument(
        "--adaptive",
        type=logits,
        metavar="SE",
        help="choose each person's next scene by their answers, until their ability is known to this standard error",
    )
    command.add_argument(
        "--difficulties",
        type=Path,
        metavar="FILE",
        help="with --adaptive: calibration.json (default: the one that ships)",
    )
    command.add_argument(
        "--seeds", metavar="LIST", help="variants: the n-th person gets the n-th seed, and so on in turn (default 0)"
    )
    command.add_argument(
        "--budget", type=count_of("iterations"), metavar="N", help="iterations of a scene (default 20)"
    )
    command.add_argument(
        "--minutes",
        type=count_of("minutes"),
        metavar="N",
        help="time of each person, from their consent (default: no limit)",
    )
    command.add_argument(
        "--feedback", action="store_true", default=None, help="tell people after each scene whether they were right"
    )
    command.add_argument(
        "--organiser", metavar="TEXT", help="whom people ask to delete their data, as the consent names you"
    )
    command.add_argument("--server", default="host", metavar="S", help="as in run (default host)")
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    command.add_argument("--port", type=port, default=0, help="port of the pages (default: any free one)")
    command.add_argument("--public-address", metavar="URL", help="address of a proxy on this machine, for the links")
    command.add_argument("--forget", metavar="CODE", help="delete the data of a person, and serve nothing")


@dataclass(frozen=True, slots=True)
class _Settings:
    """A challenge with the plan, the packs and the difficulties of its run."""

    challenge: Challenge
    plan: Plan
    packs: tuple[PackFiles, ...]
    table: DifficultyTable | None
    """Difficulties of an adaptive challenge; None if the scenes are given as a list."""


@dataclass(frozen=True, slots=True)
class _Address:
    here: str
    """Base URL of the pages on this machine."""
    public: str
    """Base URL of the proxy; empty without one."""

    @property
    def hosts(self) -> list[str]:
        """Accepted host names in addition to those of this machine."""
        return [urlsplit(self.public).hostname or ""] if self.public else []


def _challenge(args: argparse.Namespace) -> int:
    folder, console, keys = RunFolder(args.folder), Console(), KeyRing(args.scenes_dir)
    stored = read_challenge(folder)
    given = [f"--{name}" for name in _SETTINGS if getattr(args, name) is not None]
    if stored is None and args.forget:
        raise UsageError(f"--forget: {folder.path} holds no challenge")
    if stored is not None and given:
        raise UsageError(f"{folder.path} holds a challenge, whose settings stay; leave out {', '.join(given)}")
    if stored is not None and args.forget:
        remove_person(folder, stored, args.forget, keys, console)
        return 0
    settings = _new(args, keys) if stored is None else _stored(folder, stored, args)
    for key in settings.plan.matrix():
        keys.key(key.scene, key.seed)
    public = _address(args.public_address)
    folder.create(resume=stored is not None)
    with kept_if_used(folder), folder.held(), listening("127.0.0.1", args.port) as listener:
        here = f"http://127.0.0.1:{listener.getsockname()[1]}"
        run_async(lambda: _serve(folder, settings, args, listener, _Address(here, public), keys, console))
    if not folder.episodes():
        console.print("nobody has played anything")
        return 0
    return finish(folder, keys, console, as_json=False)


def _new(args: argparse.Namespace, keys: KeyRing) -> _Settings:
    """The settings of a new challenge.

    Raises:
        UsageError: An option is missing, or its value contradicts another one.
    """
    if args.people is None:
        raise UsageError(f"{args.folder} holds no challenge yet; say for how many people: --people N")
    if args.people > MOST_PEOPLE:
        raise UsageError(f"--people {args.people}: one challenge is for at most {MOST_PEOPLE}; use several folders")
    if args.scenes is None and args.adaptive is None:
        raise UsageError("say which scenes: --scenes LIST, or --adaptive SE to choose them by the answers")
    if args.difficulties is not None and args.adaptive is None:
        raise UsageError("--difficulties belongs to --adaptive")
    packs, table, adaptive = tuple(parse_scenes(args.scenes or "all", args.scenes_dir)), None, None
    if args.adaptive is not None:
        packs, table = of_known_difficulty(packs, args.difficulties, keys)
        adaptive = AdaptivePlan(se=args.adaptive, difficulties_sha256=table.sha256)
    plan = Plan(
        scenes=tuple(files.scene_id for files in packs),
        agents=(AGENT,),
        budgets=(args.budget or 20,),
        seeds=parse_numbers(args.seeds or "0", "--seeds", 0),
        epochs=args.people,
        adaptive=adaptive,
    )
    challenge = Challenge(
        minutes=args.minutes,
        feedback=bool(args.feedback),
        organiser=" ".join((args.organiser or "the organiser").split()),
        people=tuple(Person(number=number, token_sha256="?") for number in range(1, args.people + 1)),  # noqa: S106 - replaced by that of a token
    )
    return _Settings(challenge, plan, packs, table)


def _stored(folder: RunFolder, challenge: Challenge, args: argparse.Namespace) -> _Settings:
    """The settings of a challenge that is resumed from its run folder.

    Raises:
        UsageError: The file of difficulties has changed.
    """
    plan = folder.read_run().plan
    packs = tuple(find_pack(scene, args.scenes_dir) for scene in plan.scenes)
    if plan.adaptive is None:
        return _Settings(challenge, plan, packs, None)
    table = read_difficulties(args.difficulties or DIFFICULTIES)
    if table.sha256 != plan.adaptive.difficulties_sha256:
        raise UsageError(f"{folder.path}: name the --difficulties of its first start; these are others")
    return _Settings(challenge, plan, packs, table)


def _address(text: str | None) -> str:
    """The base URL of all links; empty without a proxy.

    Raises:
        UsageError: The text is not the URL of a web server.
    """
    if text is None:
        return ""
    found = urlsplit(text)
    if found.scheme not in {"https", "http"} or not found.hostname or found.query or found.fragment or found.username:
        raise UsageError(f"--public-address {text}: write an address such as https://lab.example.org")
    return text.rstrip("/")


async def _serve(
    folder: RunFolder,
    settings: _Settings,
    args: argparse.Namespace,
    listener: socket.socket,
    address: _Address,
    keys: KeyRing,
    console: Console,
) -> None:
    plan = settings.plan
    async with contextlib.AsyncExitStack() as stack:
        laboratory = await stack.enter_async_context(connect(args.server, args.scenes_dir, declared=(shows_views(),)))
        try:
            async with laboratory.open(plan.scenes[0], plan.seeds[0]) as client:
                server = await server_record(client, args.server)
        except InfrastructureError as error:
            raise UsageError(str(error)) from error
        record = continued(folder, _record(settings, server, args.scenes_dir), settings.packs)
        folder.write_run(record)
        challenge, tokens = with_tokens(folder, settings.challenge)
        write_challenge(folder, challenge)
        links = write_links(folder, challenge, tokens, address.public or address.here)
        packs = {files.scene_id: files for files in settings.packs}
        session = RunningChallenge(folder, challenge, record, packs, keys, console)
        people = [person for person in challenge.people if person.token_sha256]
        states = {person.token_sha256: session.page_of(person) for person in people}
        done = {key: strict_verdict(episode, keys) for key, episode in folder.episodes().items()}
        async with (
            serving(app(states, address.hosts), listener, session.end, _LINGER_S, most=8 * len(people) + 64),
            anyio.create_task_group() as tasks,
        ):
            console.print(f"serving {len(people)} people at {address.here}; their links are in {links}", soft_wrap=True)
            console.print("Ctrl-C ends the challenge and writes the report")
            for person in people:
                # Everyone plays each scene at one seed.
                seed = plan.seeds[(person.number - 1) % len(plan.seeds)]
                mine = [key for key in plan.matrix() if key.epoch == person.number and key.seed == seed]
                played = {key: verdict for key, verdict in done.items() if key.epoch == person.number}
                se = None if plan.adaptive is None else plan.adaptive.se
                tasks.start_soon(session.attend, person, remaining_of(mine, played, settings.table, se), laboratory)


def _record(settings: _Settings, server: ServerRecord, scenes_dir: Path | None) -> RunRecord:
    challenge = settings.challenge
    facts = {"minutes": challenge.minutes, "feedback": challenge.feedback}
    record = run_record(settings.plan, settings.packs, server, {AGENT: facts})
    return record.model_copy(update={"worlds": played_worlds(settings.packs, scenes_dir)})

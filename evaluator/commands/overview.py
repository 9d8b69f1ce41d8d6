"""The list of commands, and the entry point groups through which other distributions add commands and exports."""

from importlib.metadata import entry_points
from typing import Any

from evaluator.errors import UsageError

DESCRIPTION = """\
Let agents experiment in the PhysMent laboratory over MCP, grade their answers, and report.

  physment-eval --server stdio                     the reference agent in every scene
  physment-eval --server host --agent blind --seeds 1-20 --concurrency 8
  physment-eval --agent scripted:turns.json --scenes 7,21 --budgets 5,10
  physment-eval --agent model:gpt-5.5 --budgets 5,10,15,20 --server host --concurrency 50 --max-cost 100
  physment-eval --config study.toml --dry-run      the size of a study, without playing it
  physment-eval run --out runs/mine --resume       continue after an interruption (same options)
  physment-eval merge runs/mine --out runs/whole   merge the shards of a run
  physment-eval grade runs/mine                    grade a stored run again
  physment-eval report runs/mine runs/base --out o write report.html for two runs side by side
  physment-eval watch runs/mine                    its progress in the browser, while it is played
  physment-eval export runs/mine --to parquet      a row for each exchange; or logs of Inspect AI
  physment-eval compare runs/one runs/other        which is better, by how much, and how certainly
  physment-eval calibrate runs/one runs/other      how hard each scene is and how able each agent, with errors
  physment-eval referee                            open episodes for a trainer, and give each a reward
  physment-eval harbor write build/harbor          variants as task folders of Harbor
  physment-eval play 7                             solve a scene yourself
  physment-eval replay runs/mine                   play its episodes again and compare every return
  physment-eval fork runs/mine --episode scene=7 --turn 2 --agent model:gpt-5.5
                                                   another agent goes on from a stored episode
  physment-eval film runs/mine                     its episodes as films, for its report
  physment-eval evidence runs/mine                 were its experiments at fault, or its reasoning?
  physment-eval submit runs/mine                   its results in one file, for a leaderboard
  physment-eval check-submission FILE runs/mine    does the run give the file, graded and replayed?
  physment-eval reveal-seeds runs/mine             disclose or check the held-back seeds of a run

  physment-eval scenes list                        the scenes, with their certificates
  physment-eval scenes show 21                     what an agent learns about a scene
  physment-eval scenes new 112 --category hard-single --scenes-dir my_scenes
  physment-eval worlds make --level 5 --count 100 --out my_worlds
                                                   new laboratories from a grammar of laws
  physment-eval lint --scenes-dir my_scenes        what is wrong with a pack, without running it
  physment-eval verify --scene 112 --scenes-dir my_scenes
                                                   prove a scene sound, on twenty seeds

A run is a folder: run.json, episodes.jsonl, grades.jsonl, summary.json, report.html.
Exit code: 0 all episodes are recorded, or all scenes are sound; 1 some are not; 2 wrong usage; 130 interrupted.
"""
"""First paragraphs of `physment-eval --help`."""

COMMANDS: dict[str, tuple[str, str]] = {
    "run": ("run", "play episodes (the default)"),
    "grade": ("grade", "grade a stored run again"),
    "merge": ("grade", "put shards or parts together"),
    "report": ("report", "write the report of stored runs"),
    "watch": ("watch", "show a run in the browser while it is played"),
    "compare": ("compare", "say which of two runs is better, and with what certainty"),
    "calibrate": ("calibrate", "put agents and scenes on one scale, with errors"),
    "referee": ("referee", "open episodes for a trainer, and give each a reward"),
    "harbor": ("", "write variants as tasks of Harbor, and grade what was played there (plugin physment-harbor)"),
    "play": ("play", "solve a scene yourself"),
    "challenge": ("challenge", "let a class or the people of a study solve scenes at once"),
    "verify": ("verify", "prove scenes sound"),
    "lint": ("verify", "say what is wrong with scenes, unrun"),
    "scenes": ("scenes", "list, show, start or document scenes"),
    "worlds": ("worlds", "make, show and prove laboratories drawn from a grammar of laws"),
    "models": ("models", "list language models, and what is missing to ask them"),
    "replay": ("replay", "play recorded episodes again and compare the returns"),
    "export": ("export", "write a run as Parquet or as logs of Inspect AI"),
    "fork": ("fork", "let another agent go on from a stored episode"),
    "film": ("film", "film stored episodes for their report"),
    "evidence": ("evidence", "measure what the experiments of a run could tell"),
    "submit": ("submit", "write the results of a run for a leaderboard"),
    "check-submission": ("submit", "check a submission against its run folder"),
    "board": ("submit", "write a leaderboard page of submissions"),
    "reveal-seeds": ("submit", "disclose or check the held-back seeds of a run"),
    "replay-original": ("replay", ""),
    "keep-baselines": ("report", ""),
}
"""Command → its module and its one-line help. The module is in this folder and declares the command in `add`; it is
empty for a plugin. `--help` omits a command with an empty help text."""


COMMANDS_GROUP = "physment_eval.commands"
"""Entry point group of commands. An entry point is a function that adds options to a parser and sets its `run`."""
EXPORTS_GROUP = "physment_eval.exports"
"""Entry point group of export formats. An entry point is a function of a folder, the record of a run, and its episodes
with their grades; it writes files into the folder and returns their paths."""


def plugin(group: str, name: str, words: str) -> Any:
    """Load the entry point of a plugin from `integrations/`.

    Args:
        group: Group of the entry point.
        name: Name of the entry point and of the plugin's folder.
        words: The command that needs the plugin, for error messages.

    Raises:
        UsageError: The plugin is not installed or cannot be imported.
    """
    for found in entry_points(group=group, name=name):
        try:
            return found.load()
        except ImportError as error:
            raise UsageError(f"{words}: the plugin {found.value} cannot be imported: {error}") from error
    raise UsageError(
        f"{words} needs the plugin physment-{name}, which is not installed: in a checkout,"
        f" pip install ./integrations/{name}"
    )

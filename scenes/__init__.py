"""Scene packs: their format, their folders, and how hidden values are sampled from a seed.

Handles JSON, XML text and random numbers. Depends on neither MCP nor MuJoCo, and has no code for agents or verdicts.
"""

from scenes.answer_spec import AnswerKind, AnswerSpec, Scalar
from scenes.content import content_hash_of, pack_hash, same_pack, same_packs
from scenes.draw import KnobValue, draw_knobs
from scenes.errata import Erratum, ErratumEffect, read_errata
from scenes.errors import PackError, WorldError
from scenes.export import export_packs
from scenes.finding import find_pack
from scenes.folder import PackFiles, default_folder, list_packs, read_pack
from scenes.laboratory import Instruments, LabLimits, Noise, SystematicBounds
from scenes.model import USUAL_TIMESTEP_S, changed_mjcf, drawn_mjcf, timestep_of
from scenes.new import write_new_scene
from scenes.pack import CANARY, Catch, Category, Law, Pack, Permissions, Rung
from scenes.public import AnswerForm, PublicObject, PublicPack, PublicQuantity, hosted_files, read_hosted, read_public
from scenes.world_names import is_world, one_world, place_of, reference_of

__all__ = [
    "CANARY",
    "USUAL_TIMESTEP_S",
    "AnswerForm",
    "AnswerKind",
    "AnswerSpec",
    "Catch",
    "Category",
    "Erratum",
    "ErratumEffect",
    "Instruments",
    "KnobValue",
    "LabLimits",
    "Law",
    "Noise",
    "Pack",
    "PackError",
    "PackFiles",
    "Permissions",
    "PublicObject",
    "PublicPack",
    "PublicQuantity",
    "Rung",
    "Scalar",
    "SystematicBounds",
    "WorldError",
    "changed_mjcf",
    "content_hash_of",
    "default_folder",
    "draw_knobs",
    "drawn_mjcf",
    "export_packs",
    "find_pack",
    "hosted_files",
    "is_world",
    "list_packs",
    "one_world",
    "pack_hash",
    "place_of",
    "read_errata",
    "read_hosted",
    "read_pack",
    "read_public",
    "reference_of",
    "same_pack",
    "same_packs",
    "timestep_of",
    "write_new_scene",
]

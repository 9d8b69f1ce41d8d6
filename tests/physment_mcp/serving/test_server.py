"""Tests of the server apart from tools: instructions, prompt, resources, completion, progress, cancellation."""

import base64
import json
import struct
from typing import Any

import anyio
import pytest
from mcp import Client, MCPError
from mcp_types import PromptReference

from physment_mcp.scene import list_scenes, load_scene
from physment_mcp.serving import slot
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import KEPT_CALLS, MAX_PAGE_BYTES, EpisodeSlot
from physment_mcp.session import Session
from tests.builders.laboratory import OpenLab, WritePack

PROMPTING = ("zero-shot", "one-shot-cot", "few-shot-cot")


async def prompt_text(client: Client, **arguments: str) -> str:
    rendered = await client.get_prompt("scene", arguments or None)
    assert [message.role for message in rendered.messages] == ["user"]
    return rendered.messages[0].content.text


@pytest.fixture
def idle(write_pack: WritePack, pack: dict[str, Any], xml: str) -> EpisodeSlot:
    folder = write_pack(pack, xml, 7)
    write_pack({**pack, "metadata": pack["metadata"] | {"scene_name": "Another"}}, xml, 70)
    write_pack({**pack, "answer": None}, xml, 8)
    return EpisodeSlot(reopen=lambda scene_id: Session(load_scene(scene_id, 0, folder)), scene_ids=[7, 8, 70])


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_instructions_are_the_opening_prompt(open_lab: OpenLab, mode: str) -> None:
    async with open_lab(mode=mode) as lab:
        assert lab.server_info.name == "physment-mcp"
        assert lab.instructions == await prompt_text(lab.client)
        assert lab.instructions == await prompt_text(lab.client, scene_id="7")


async def test_the_opening_prompt_shows_what_the_permissions_show(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        text = lab.instructions
    assert "How heavy is the ball?" in text
    # Mass of a ball: 1000 · 4/3 π 0.1³ = 4.18879 kg.
    ball = "| object_1 | ball | sphere | 1000 | 4.18879 | [0.2, 0.2, 0.2] | 0.1 | [0, 0, 1] | [1, 0, 0, 0] |"
    assert ball in text
    assert "| object_6 | masked ball | n/a | n/a | n/a | n/a | n/a | n/a | n/a |" in text
    assert "Sealed, to be observed but not acted on: object_4." in text
    assert "Velocity and what follows from it withheld: object_6." in text
    assert "object_5" not in text
    assert "ghost" not in text
    assert "a number with at least three significant digits, without its unit (in kg)" in text


@pytest.mark.parametrize("prompting", PROMPTING)
@pytest.mark.parametrize("protocol", ["native", "text"])
@pytest.mark.parametrize("budget", [None, "1", "15"])
async def test_every_prompt_option_changes_the_prompt(
    open_lab: OpenLab, prompting: str, protocol: str, budget: str | None
) -> None:
    options = {"prompting": prompting, "protocol": protocol} | ({} if budget is None else {"budget": budget})
    async with open_lab() as lab:
        text = await prompt_text(lab.client, **options)
        tools = [tool.name for tool in (await lab.client.list_tools()).tools]
    assert text.count("\nTask: ") == {"zero-shot": 0, "one-shot-cot": 1, "few-shot-cot": 3}[prompting]
    assert ("```json" in text) == (protocol == "text")
    assert all(f"- `{name}(" in text for name in tools) == (protocol == "text")
    assert (f"You have {budget} iterations" in text) == (budget is not None)


@pytest.mark.parametrize(
    ("spec", "problem_type", "told"),
    [
        (None, "comparison", "Answer with the id or number the task asks for."),
        (None, "observation", "Answer with the number of the case the task asks for."),
        (None, "computation", "Answer with a list of numbers in the order of the task."),
        (None, "riddle", "Answer with a number with at least three significant digits, without its unit."),
        ({"kind": "number", "unit": "1"}, "x", "without its unit (no unit)."),
        (
            {"kind": "numbers", "unit": ["m", "1"], "labels": ["length", "ratio"]},
            "x",
            "at least three significant digits, in this order: length (in m); ratio (no unit).",
        ),
        ({"kind": "numbers", "unit": "m", "labels": ["a", "b"]}, "x", "in this order: a (in m); b (in m)."),
        ({"kind": "numbers"}, "x", "a list of numbers, each with at least three significant digits."),
        ({"kind": "choice", "options": ["rolls", "slips"]}, "x", "Answer with exactly one of: rolls, slips."),
        ({"kind": "objects", "options": ["object_1", "object_2"]}, "x", "exactly one of: object_1, object_2."),
        ({"kind": "text"}, "x", "Answer in one sentence of at most ten words, in the words of the task."),
        (
            {
                "kind": "formula",
                "unit": "N",
                "variables": {"d": {"meaning": "distance", "unit": "m", "range": [0.1, 2]}},
            },
            "x",
            "Answer with a formula (in N) in these variables: d, distance (in m), from 0.1 to 2.",
        ),
    ],
)
async def test_the_opening_prompt_says_what_an_answer_looks_like(
    open_lab: OpenLab, pack: dict[str, Any], spec: dict[str, Any] | None, problem_type: str, told: str
) -> None:
    pack["answer_spec"] = spec
    pack["metadata"]["problem_type"] = problem_type
    async with open_lab(pack) as lab:
        assert told in lab.instructions


async def test_a_scene_of_hidden_objects_alone_shows_none(open_lab: OpenLab, pack: dict[str, Any]) -> None:
    for permissions in pack["object_permissions"].values():
        permissions["hidden"] = True
    async with open_lab(pack) as lab:
        assert "You see no object that you could name." in lab.instructions
        assert "you can use are none yet" in await lab.refused("get_position", object_id=1)


async def test_the_opening_prompt_stays_what_it_was_at_the_start(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        await lab.call("step", duration=0.3)
        await lab.call("find_objects")
        await lab.call("delete_objects", object_id="object_2")
        assert await prompt_text(lab.client) == lab.instructions
        await lab.call("answer", answer=1)
        assert await prompt_text(lab.client) == lab.instructions


@pytest.mark.parametrize(
    "options",
    [
        {"prompting": "many-shot"}, {"protocol": "xml"}, {"budget": "0"}, {"budget": "-1"}, {"budget": "ten"},
        {"budget": "1.5"}, {"budget": ""}, {"budget": "9" * 5000}, {"scene_id": "8"}, {"scene_id": "x"},
    ],
)  # fmt: skip
@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_bad_prompt_option_is_an_error_that_says_what_is_good(
    open_lab: OpenLab, options: dict[str, str], mode: str
) -> None:
    async with open_lab(mode=mode) as lab:
        before = lab.state()
        with pytest.raises(MCPError) as refusal:
            await lab.client.get_prompt("scene", options)
        assert refusal.value.error.code == -32602
        assert lab.state() == before
        with pytest.raises(MCPError, match="the prompt is scene"):
            await lab.client.get_prompt("seed")


async def test_the_prompt_is_listed_with_its_arguments(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        (prompt,) = (await lab.client.list_prompts()).prompts
    assert prompt.name == "scene"
    assert [one.name for one in prompt.arguments or []] == ["scene_id", "prompting", "protocol", "budget"]
    assert not any(one.required for one in prompt.arguments or [])


async def test_resources_show_the_scene_and_where_the_episode_stands(open_lab: OpenLab) -> None:
    async def read(uri: str) -> dict[str, Any]:
        (contents,) = (await lab.client.read_resource(uri)).contents
        assert contents.mime_type == "application/json"
        return json.loads(contents.text)

    async with open_lab() as lab:
        listed = (await lab.client.list_resources()).resources
        assert [str(resource.uri) for resource in listed] == [
            f"physment://{name}" for name in ("scene", "episode", "measurements", "scenes")
        ]
        assert all(resource.title and resource.description and resource.icons for resource in listed)
        scene = await read("physment://scene")
        assert (scene["scene_id"], scene["name"], scene["timestep_s"]) == (7, "All kinds", 0.005)
        known = ["object_1", "object_2", "object_3", "object_4", "object_6", "object_7", "object_8", "object_9"]
        assert [item["object_id"] for item in scene["objects"]] == known
        assert scene["answer"] == {"kind": "number", "unit": "kg", "labels": [], "options": []}
        await lab.call("step", duration=0.1)
        assert await read("physment://episode") == {
            "phase": "running",
            "sim_time": lab.session.world.time,
            "calls": 1,
            "objects": known,
        }
        await lab.call("answer", answer=1)
        assert (await read("physment://episode"))["phase"] == "answered"
        assert await read("physment://scene") == scene
        with pytest.raises(MCPError, match="physment://scene"):
            await lab.client.read_resource("physment://answer")


async def notes_of(client: Client) -> dict[str, Any]:
    (contents,) = (await client.read_resource("physment://measurements")).contents
    return json.loads(contents.text)


async def test_the_measurements_are_what_the_agent_has_seen(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        assert await notes_of(lab.client) == {"left_out": 0, "calls": []}
        stepped = await lab.call("step", duration=0.1)
        refused = await lab.refused("get_velocity", object_id="object_5")
        seen = await notes_of(lab.client)
        assert seen["calls"] == [
            {"call": 1, "tool": "step", "arguments": {"duration": 0.1}, "result": stepped},
            {"call": 2, "tool": "get_velocity", "arguments": {"object_id": "object_5"}, "refused": refused},
        ]
        await lab.call("answer", answer=[1, "kg"])
        await lab.refused("step", duration=1)
        after = await notes_of(lab.client)
        assert [noted["tool"] for noted in after["calls"]] == ["step", "get_velocity", "answer"]
        assert lab.session.calls == 3  # reading the notes is not a call


async def test_a_cancelled_call_is_recorded_as_cancelled(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        with anyio.move_on_after(120):
            async with anyio.create_task_group() as tasks:

                async def stop(progress: float, total: float | None, message: str | None) -> None:
                    tasks.cancel_scope.cancel()

                await lab.client.call_tool("step", {"duration": 60}, progress_callback=stop)
        assert (await notes_of(lab.client))["calls"] == [
            {"call": 1, "tool": "step", "arguments": {"duration": 60}, "taken_back": True}
        ]


async def notes_from(client: Client, call: int) -> dict[str, Any]:
    (contents,) = (await client.read_resource(f"physment://measurements/{call}")).contents
    return json.loads(contents.text)


async def test_the_measurements_are_bounded(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        await lab.refused("get_velocity", object_id="x" * 50_000)
        for _ in range(KEPT_CALLS):
            await lab.call("quat_to_rot_matrix", q=[1, 0, 0, 0])
        read = 1
        while page := (await notes_from(lab.client, read + 1))["calls"]:
            assert page[0]["call"] == read + 1
            read += len(page)
        assert read == KEPT_CALLS + 1
        assert (await notes_from(lab.client, 1))["left_out"] == 1
        await lab.refused("get_velocity", object_id="x" * 50_000)
        seen = await notes_of(lab.client)
        assert seen["calls"][-1]["arguments"]["left_out"].startswith("the arguments of a call hold at most")
        assert len(json.dumps(seen["calls"][-1])) < 1000


async def test_the_measurements_are_read_page_by_page(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        for number in range(40):
            await lab.refused("get_velocity", object_id=f"{number:02}" + "x" * 5000)
        newest = await notes_of(lab.client)
        assert len(json.dumps(newest)) < 1.1 * MAX_PAGE_BYTES
        assert newest["calls"][-1]["call"] == 40
        assert newest["left_out"] == newest["calls"][0]["call"] - 1 > 0
        read: list[str] = []
        while page := (await notes_from(lab.client, len(read) + 1))["calls"]:
            assert page[0]["call"] == len(read) + 1
            assert len(json.dumps(page)) < 1.1 * MAX_PAGE_BYTES
            read += [noted["arguments"]["object_id"][:2] for noted in page]
        assert read == [f"{number:02}" for number in range(40)]
        for address in ("x", "-1", "1" * 20):
            with pytest.raises(MCPError, match="there is no resource"):
                await lab.client.read_resource(f"physment://measurements/{address}")


async def test_an_episode_that_has_brought_too_much_can_only_answer(
    open_lab: OpenLab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slot, "MAX_EPISODE_BYTES", 50_000)
    async with open_lab() as lab:
        for _ in range(4):
            await lab.refused("get_velocity", object_id="x" * 15_000)
        before = lab.session.world.time
        assert await lab.refused("step", duration=1) == slot.FULL
        assert (lab.session.world.time, lab.session.calls) == (before, 5)
        assert (await notes_of(lab.client))["calls"][-1]["arguments"] == {"left_out": slot.FULL}
        await lab.call("answer", answer=3)
        assert (await notes_of(lab.client))["calls"][-1]["arguments"] == {"answer": 3}


async def test_the_catalogue_lists_the_scenes_that_can_be_opened(
    open_lab: OpenLab, write_pack: WritePack, pack: dict[str, Any], xml: str
) -> None:
    async def catalogue(client: Client) -> list[dict[str, Any]]:
        (contents,) = (await client.read_resource("physment://scenes")).contents
        return json.loads(contents.text)["scenes"]

    card = {
        "scene_id": 7, "name": "All kinds", "problem_type": "calculation", "task": "How heavy is the ball?",
    }  # fmt: skip
    async with open_lab() as lab:
        assert await catalogue(lab.client) == [card]
    folder = write_pack(pack, xml, 7)
    write_pack({**pack, "answer": None}, xml, 8)  # cannot be opened, so it is not listed
    write_pack({**pack, "metadata": pack["metadata"] | {"scene_name": "Another"}}, xml, 70)
    async with Client(build_server(EpisodeSlot(list_scenes=lambda: list_scenes(folder)))) as client:
        assert await catalogue(client) == [card, card | {"scene_id": 70, "name": "Another"}]


async def test_clients_may_cache_only_what_never_changes(open_lab: OpenLab, idle: EpisodeSlot) -> None:
    async with open_lab() as lab:
        same = [
            await lab.client.list_tools(), await lab.client.list_prompts(), await lab.client.list_resources()
        ]  # fmt: skip
        assert all(listing.ttl_ms > 0 and listing.cache_scope == "public" for listing in same)
        hints = {}
        for name in ("scene", "scenes", "episode", "measurements"):
            read = await lab.client.read_resource(f"physment://{name}")
            assert read.cache_scope == "private"
            hints[name] = read.ttl_ms > 0
        assert hints == {"scene": True, "scenes": True, "episode": False, "measurements": False}
    async with Client(build_server(idle)) as client:  # it may open another scene at any time
        for name in ("scene", "episode", "measurements"):
            assert (await client.read_resource(f"physment://{name}")).ttl_ms == 0


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_the_resource_templates_may_be_cached(open_lab: OpenLab, mode: str) -> None:
    async with open_lab(mode=mode) as lab:
        found = await lab.client.list_resource_templates()
    assert [template.uri_template for template in found.resource_templates] == ["physment://measurements/{call}"]
    if mode == "auto":  # older protocols have no such hints
        assert found.ttl_ms > 0
        assert found.cache_scope == "public"


async def test_an_unknown_resource_is_named_in_the_error(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        with pytest.raises(MCPError, match="the resources are physment://scene") as refused:
            await lab.client.read_resource("physment://nothing")
    assert refused.value.error.data == {"uri": "physment://nothing"}


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_clients_receive_titles_and_icons(open_lab: OpenLab, mode: str) -> None:
    async with open_lab(mode=mode) as lab:
        info = lab.server_info
        (prompt,) = (await lab.client.list_prompts()).prompts
        assert info.title == "PhysMent laboratory"
        assert info.description
        assert prompt.title
        assert prompt.arguments
        assert all(one.title for one in prompt.arguments)
        for icons in (info.icons, prompt.icons):
            assert icons is not None
            (icon,) = icons
            head, _, body = icon.src.partition(",")
            assert head == "data:image/png;base64"
            picture = base64.b64decode(body, validate=True)
            assert picture.startswith(b"\x89PNG\r\n")
            width, height = struct.unpack(">II", picture[16:24])
            assert icon.sizes == [f"{width}x{height}"]


async def test_completion_offers_the_values_of_prompt_arguments(idle: EpisodeSlot) -> None:
    scene = PromptReference(name="scene")

    async def offered(argument: str, value: str) -> list[str]:
        return (await client.complete(scene, {"name": argument, "value": value})).completion.values

    async with Client(build_server(idle)) as client:
        assert await offered("scene_id", "") == ["7", "8", "70"]
        assert await offered("scene_id", "7") == ["7", "70"]
        assert await offered("scene_id", "9") == []
        assert await offered("prompting", "f") == ["few-shot-cot"]
        assert await offered("protocol", "") == ["native", "text"]
        assert await offered("budget", "1") == ["10", "15"]
        assert await offered("seed", "") == []


async def test_an_idle_start_opens_scenes_by_prompt(idle: EpisodeSlot) -> None:
    async with Client(build_server(idle)) as client:
        assert "No scene is open yet" in (client.instructions or "")
        assert len((await client.list_tools()).tools) == 26
        (prompt,) = (await client.list_prompts()).prompts
        assert [argument.name for argument in prompt.arguments or [] if argument.required] == ["scene_id"]
        early = await client.call_tool("get_position", {"object_id": "object_1"})
        assert early.is_error
        assert early.content[0].text == "no scene is open yet: use the prompt `scene` with a scene_id to open one"
        (contents,) = (await client.read_resource("physment://episode")).contents
        assert json.loads(contents.text) == {"phase": "idle"}
        for wrong in ({}, {"scene_id": ""}, {"scene_id": "seven"}, {"scene_id": "9" * 5000}, {"scene_id": "-7"}):
            with pytest.raises(MCPError, match="scene_id must be the number of a scene"):
                await client.get_prompt("scene", wrong)
        # A client must not learn where the packs are or what is wrong in them.
        with pytest.raises(MCPError, match=r"^no scene 9; the scenes here are [078, -]+$"):
            await client.get_prompt("scene", {"scene_id": "9"})
        with pytest.raises(MCPError, match=r"^this scene cannot be opened; its operator can see why$"):
            await client.get_prompt("scene", {"scene_id": "8"})
        assert idle.session is None

        assert "# Scene: All kinds" in await prompt_text(client, scene_id="7")
        assert not (await client.call_tool("answer", {"answer": 1})).is_error
        assert (await client.call_tool("step", {"duration": 1})).is_error
        assert "# Scene: All kinds" in await prompt_text(client, budget="5")
        assert (await client.call_tool("step", {"duration": 1})).is_error

        assert len((await notes_of(client))["calls"]) == 1
        assert "# Scene: Another" in await prompt_text(client, scene_id="70")
        assert (await notes_of(client))["calls"] == []
        assert not (await client.call_tool("step", {"duration": 1})).is_error


async def test_a_scene_on_the_command_line_cannot_be_reopened(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        await lab.call("answer", answer=1)
        await prompt_text(lab.client, scene_id="7")
        assert "the episode is over" in await lab.refused("step", duration=1)


async def test_progress_of_a_long_step_rises_and_does_not_exceed_its_length(open_lab: OpenLab) -> None:
    seen: list[tuple[float, float | None]] = []

    async def note(progress: float, total: float | None, message: str | None) -> None:
        seen.append((progress, total))

    async with open_lab() as lab:
        await lab.client.call_tool("step", {"duration": 10}, progress_callback=note)
    assert seen
    done = [reached for reached, _ in seen]
    assert done == sorted(set(done))
    assert done[0] > 0
    assert done[-1] < 10
    assert {total for _, total in seen} == {10.0}


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_cancelled_step_changes_nothing(open_lab: OpenLab, mode: str) -> None:
    async with open_lab(mode=mode) as lab:
        await lab.call("apply_force", object_id=1, force_vector=[1, 2, 3])
        await lab.call("step", duration=0.1)
        before = lab.state()
        with anyio.fail_after(120):
            async with anyio.create_task_group() as tasks:

                async def stop(progress: float, total: float | None, message: str | None) -> None:
                    tasks.cancel_scope.cancel()

                await lab.client.call_tool("step", {"duration": 60}, progress_callback=stop)
                pytest.fail("60 s are many chunks: the first report of progress comes before the end")
            # The next call waits for the lock, so the roll-back is done.
            await lab.call("get_torque", object_id=1)
        assert lab.state() == before


async def test_calls_run_one_at_a_time(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        times: list[float] = []

        async def step() -> None:
            times.append((await lab.call("step", duration=2))["sim_time"])

        async with anyio.create_task_group() as tasks:
            for _ in range(4):
                tasks.start_soon(step)
    assert sorted(times) == pytest.approx([2, 4, 6, 8])

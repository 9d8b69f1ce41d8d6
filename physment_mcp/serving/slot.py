"""The place of one episode in a server: the open episode, how to open another, and the log of its calls.

Knows sessions and the log of calls. Knows no MCP handlers, no transports and no files.
"""

from collections.abc import Callable, Sequence
from functools import cached_property

from physment_mcp.errors import EpisodeGone, EpisodeOver
from physment_mcp.scene import Scene
from physment_mcp.serving.call_log import CallLog
from physment_mcp.serving.frames import Frames
from physment_mcp.serving.scheduling import Scheduler, Turns
from physment_mcp.session import Session
from physment_mcp.visibility import Visibility
from scenes import PublicPack

KEPT_CALLS = 500
"""Calls that the log keeps of an episode without a limit, so that a host of many episodes needs bounded memory."""


class EpisodeSlot:
    """The place of at most one open episode; its calls run one at a time."""

    def __init__(
        self,
        session: Session | None = None,
        *,
        reopen: Callable[[int], Session] | None = None,
        scene_ids: Sequence[int] = (),
        list_scenes: Callable[[], Sequence[PublicPack]] | None = None,
        gone: str | None = None,
        watch: Callable[[Session], Frames] | None = None,
        scheduler: Scheduler | None = None,
        find_visibility: Callable[[Scene], Visibility] | None = None,
    ) -> None:
        """Set up.

        Args:
            session: The open episode; None for an idle start.
            reopen: For an idle start, opens an episode by scene id.
            scene_ids: Which scenes can be opened; by default the open one.
            list_scenes: Lists the scenes that can be opened; by default the open one.
            watch: Makes the frames for results; None for results without frames.
            gone: Why there is no episode and none can be opened; None if one is or can be open.
            find_visibility: Finds what may be seen in a scene, for clients that show the app; None for none.
            scheduler: The other episodes of its host; None for an episode alone.
        """
        self.session = session
        self.reopen = reopen
        self.scene_ids = scene_ids or ([] if session is None else [session.scene.public.scene_id])
        self.gone = gone
        self.turns = Turns(scheduler)
        self.log = CallLog()
        self.frames: Frames | None = None
        self._watch = watch
        self._find_visibility = find_visibility
        self._list_scenes = list_scenes
        if session is not None:
            self.enter(session)

    @property
    def offers_app(self) -> bool:
        """Whether a client that shows apps gets the one that draws. Not with a limit of calls: showing is no call."""
        return self._find_visibility is not None and (self.session is None or self.session.max_calls is None)

    def visibility(self, session: Session) -> Visibility:
        """What may be seen in the scene of a session, where the app is offered. Blocks.

        Raises:
            SceneError: The folder holds too few variants of the scene.
        """
        assert self._find_visibility is not None
        return self._find_visibility(session.scene)

    @property
    def fixed(self) -> bool:
        """True if no other episode can be opened here."""
        return self.reopen is None and self.session is not None

    def enter(self, session: Session) -> None:
        """Make a session the open episode, with an empty log."""
        frames = None if self._watch is None else self._watch(session)
        self.session, self.frames = session, frames
        # With a limit, the log is the record of the episode for its owner, so it must be complete.
        self.log = CallLog(kept=KEPT_CALLS if session.max_calls is None else None)

    def close(self, gone: str) -> None:
        """Let go of the episode: its model and state take a megabyte, and the garbage collector does not see them.

        Args:
            gone: Tells further calls why there is no episode.
        """
        self.session, self.frames, self.gone, self.log = None, None, gone, CallLog()

    def open_session(self) -> Session:
        """The open episode.

        Raises:
            EpisodeGone: It is gone, and none can be opened here.
            EpisodeOver: No scene is open yet.
        """
        if self.gone is not None:
            raise EpisodeGone(self.gone)
        if self.session is None:
            raise EpisodeOver("no scene is open yet: use the prompt `scene` with a scene_id to open one")
        return self.session

    @cached_property
    def catalogue(self) -> tuple[PublicPack, ...]:
        """The scenes that can be opened here."""
        if self._list_scenes is not None:
            return tuple(self._list_scenes())
        return () if self.session is None else (self.session.scene.public,)

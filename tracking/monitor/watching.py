"""How a run is watched: the options, and the observers that they ask for."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from pydantic import Field
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import Options
from tsuiseki.tracking.runs.messages import complain

if TYPE_CHECKING:
    from tsuiseki.tracking.counts.scene import Scene
    from tsuiseki.tracking.monitor.board import Board
    from tsuiseki.tracking.monitor.pictures import Hidden
    from tsuiseki.tracking.people.settings import Detecting
    from tsuiseki.tracking.types.live import CameraState, Observer
    from tsuiseki.tracking.video.frame_source import Source


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Watching(Options):
    """How the run is watched.

    Attributes:
        events: send events to -, a file, or an address http://… or mqtt://….
        page: port of a live page for this computer, with /health and /metrics.
        show: show pictures in a window.
        scene: lines and zones for events, page, overlay; tsuiseki scene draws them.
    """

    events: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    page: Annotated[int, Field(ge=0, le=65_535)] | None = None
    show: bool = False
    scene: Path | None = None

    @property
    def wanted(self) -> bool:
        """Whether the run is watched at all."""
        return self.events is not None or self.pictured

    @property
    def pictured(self) -> bool:
        """Whether somebody sees its pictures."""
        return self.page is not None or self.show

    def check(self) -> None:
        """Refuse what cannot be had on this computer; raises RequestError."""
        if self.page is not None:
            from tsuiseki.tracking.report.page_server import check_packages

            check_packages("`page`")
        if self.show:
            from tsuiseki.tracking.monitor.window import check_window

            check_window()

    def check_scene(self, overlay: bool) -> None:
        """Refuse a scene that nothing shows or takes events from; raises RequestError."""
        if self.scene is not None and not (self.wanted or overlay):
            raise RequestError(
                "expected `scene` with `events`, `page` or `overlay`, got it alone; tsuiseki count takes it, too"
            )

    @contextmanager
    def own_output(self) -> Iterator[None]:
        """Where events go to the program's output, nothing else does within the ``with`` block."""
        with redirect_stdout(sys.stderr) if self.events == "-" else nullcontext():
            yield

    @contextmanager
    def observers(
        self,
        out: Path,
        sources: Sequence[Source],
        cameras: Sequence[CameraState] = (),
        hide: str | None = None,
        finding: Detecting | None = None,
        on_floor: bool = False,
    ) -> Iterator[list[Observer]]:
        """What watches a run whose result goes to the folder ``out``; it ends with the ``with`` block.

        Args:
            out: it is there.
            sources: of the run.
            cameras: what each source has given; by default counted here.
            hide: whom to hide in pictures, see `HideChoice`; None for nobody.
            finding: how people are detected.
            on_floor: the scene is of the floor that all sources see, in metres.

        Raises:
            RequestError: a receiver, the scene, the page or the window cannot be had.
        """
        scene, recorded = self.scene_of([] if on_floor else sources), not any(source.live for source in sources)
        if on_floor and scene is not None:
            scene.on_floor()
        self.check()
        with ExitStack() as stack:
            observers: list[Observer] = []
            events = None
            if self.events is not None:
                from tsuiseki.tracking.events.observer import EventObserver

                events = EventObserver.open(self.events, out, complain, scene, recorded)
                stack.callback(events.close)
                observers.append(events)
            if self.pictured:
                from tsuiseki.tracking.monitor.board import Board
                from tsuiseki.tracking.monitor.pictures import PictureMaker

                hidden = None if hide is None else hidden_people(sources, hide, finding)
                waiting = events.waiting if events is not None else lambda: 0
                names, in_pictures = [source.name for source in sources], None if on_floor else scene
                board = Board(
                    out.resolve().name,
                    in_pictures,
                    cameras or names,
                    recorded,
                    PictureMaker(hidden, in_pictures),
                    waiting,
                )
                stack.callback(board.close)
                observers += [board, *self._shown(board, out, stack)]
            yield observers

    def _shown(self, board: Board, out: Path, stack: ExitStack) -> list[Observer]:
        """Serve the page, and open the window, where they are asked for."""
        if self.page is not None:
            from tsuiseki.tracking.monitor.server import application
            from tsuiseki.tracking.report.local_page import HOST, token_of
            from tsuiseki.tracking.report.page_server import listening, serving

            opened, token = listening(self.page), token_of(out)
            port = opened.getsockname()[1]
            if self.page not in (0, port):
                complain(f"note: port {self.page} is in use; the live page has another one")
            stack.enter_context(serving(application(board, token, port), opened))
            print(f"live page: http://{HOST}:{port}/{token}/", file=sys.stderr, flush=True)
        if not self.show:
            return []
        from tsuiseki.tracking.monitor.window import Window

        window = Window(board)
        stack.callback(window.close)
        return [window]

    def scene_of(self, sources: Sequence[Source]) -> Scene | None:
        """The scene, which fits the pictures of all sources; None without one.

        Raises:
            RequestError: it is wrong, or of another size.
        """
        from tsuiseki.tracking.counts.scene import read_scene

        if self.scene is None:
            return None
        scene = read_scene(self.scene)
        for source in sources:
            scene.check_video(source.size, str(self.scene))
        return scene


def hidden_people(sources: Sequence[Source], hide: str, finding: Detecting | None) -> Hidden:
    """Whom to hide in the pictures of sources, and the sensitive detector that finds them there."""
    from tsuiseki.tracking.hiding.run import SENSITIVE, HideChoice
    from tsuiseki.tracking.monitor.pictures import Hidden
    from tsuiseki.tracking.people.detections import people_detect
    from tsuiseki.tracking.people.settings import PeopleFinding
    from tsuiseki.tracking.weights import PEOPLE_DETECTOR

    choice = HideChoice.parse(hide)
    finding = finding if isinstance(finding, PeopleFinding) else PeopleFinding()
    score = min(finding.threshold, SENSITIVE)
    second = replace(
        finding, detections=None, classes=None, across_classes=False, score_range=None, score_threshold=score
    )
    detect: Any = people_detect(sources[0], second, PEOPLE_DETECTOR, finding.threads)
    return Hidden(detect, choice.heads, choice.visible)

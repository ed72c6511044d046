"""What a browser shows and asks for: viser's edge. All that a picture is made of lies in the other modules."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser

from aa4d.capture.schema import Frame
from aa4d.methods import title_of
from aa4d.methods.model_file import LoadedModel
from aa4d.viewer.arrangement import SIDE_BY_SIDE, Choice, choices, unlike
from aa4d.viewer.cameras import Array, Eye, fov_that_shows, to_orbit, viewmat_of, wxyz_of
from aa4d.viewer.drawing import Drawing, Sent
from aa4d.viewer.following import SAME_PLACE
from aa4d.viewer.pictures import LAYER_NAMES, Scale, Wanted, legend, point_under
from aa4d.viewer.playing import Playing
from aa4d.viewer.resolution import Size
from aa4d.viewer.riding import Ride, frame_after
from aa4d.viewer.seat import Seat
from aa4d.viewer.server import Server
from aa4d.viewer.shown import OF_FOOTAGE, Shown

SPEEDS = {"1/10": 0.1, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "4": 4.0}
MOST_FRUSTUMS = 24  # evenly over the clip: more hide what they look at
FRUSTUM = 0.03  # size, of the model's unit
HELD_OUT, TRAINING = (230, 150, 40), (170, 190, 210)
SECONDS_BETWEEN_TEXTS = 0.2  # more often nobody reads them, and each is a message to every browser
COARSE_QUALITY, SHARP_QUALITY = 75, 92  # of JPEG
KEYS = (
    "Drag: orbit. Right button: move. Wheel: nearer. **Shift+click**: orbit that point. **Space**: play. "
    "**N**, **B**: next frame, the one before. **F**: fly along. **T**: tracks. **L**: next layer. **V**: next view."
)


@dataclass
class Page:
    """The panel, the scene and every browser that has it open; time, layer and models are the same in all."""

    server: Server
    drawing: Drawing
    _seats: dict[int, Seat] = field(default_factory=dict)
    _troubles: dict[int, str] = field(default_factory=dict)  # by the number of a model
    _texts_at: float = 0.0
    _scale: Scale | None = None  # that the panel explains
    # Controls: mypy takes values that can be set for read-only, as viser writes them.
    _time: Any = None
    _play: Any = None
    _show: Any = None
    _layer: Any = None
    _fly: Any = None
    _tracks: Any = None
    _cameras: Any = None

    def __post_init__(self) -> None:
        first = self._first
        self._playing = Playing(first.frames[0].time_s, first.frames[-1].time_s, first.frames[0].time_s)
        self._choices = choices(unlike([shown.name for shown in self.drawing.shown]))
        self._set_camera()
        self._set_panel()
        self._set_frustums()
        self._set_keys()
        self.server.scene.on_click(modifier="shift")(self._orbit_point)
        self.server.on_client_connect(self._arrive)
        self.server.on_client_disconnect(self._leave)

    # What is wanted.

    @property
    def choice(self) -> Choice:
        return next(c for c in self._choices if c.name == self._show.value)

    def wanted(self, seat: Seat, now: float) -> tuple[Wanted, Size]:
        choice, second = self.choice, self._playing.at(now)
        layer = self._layer.value
        eye = seat.eye
        if self._fly.value:
            eye = seat.ride.eye(second, seat.aspect, at_frames=layer in OF_FOOTAGE)
        wanted = Wanted(eye, seat.aspect, second, layer, choice.models, choice.arrangement, self._tracks.value)
        return wanted, seat.size

    def replace(self, index: int, shown: Shown) -> None:
        """A model has changed on disk."""
        self.drawing.replace(index, shown)
        self._troubles.pop(index, None)
        for seat in self._seats.values() if index == 0 else ():
            seat.ride = Ride(shown)
        self._title.content = self._about()
        if self._layer.options != self._layers():  # what begins to move has more of them
            self._layer.options = self._layers()

    def warn(self, index: int, trouble: str) -> None:
        """Show that a model can no longer be read from the disk, and why."""
        self._troubles[index] = trouble
        self._title.content = self._about()

    # The panel.

    def _set_panel(self) -> None:
        gui = self.server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="medium")
        self._title = gui.add_markdown(self._about())
        play = self._playing
        can_play = play.last > play.first
        steps = max(len(self._first.frames) - 1, 1)
        step = max(round((play.last - play.first) / steps / 4, 3), 0.001)
        first, last = round(play.first, 3), round(play.last, 3)
        self._time = gui.add_slider("Time, s", first, last, step, first, disabled=not can_play)
        self._time.on_update(self._scrubbed)
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, disabled=not can_play)
        self._play.on_click(lambda _: self._toggle_play())
        self._speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1")
        self._speed.on_update(lambda _: self._set_speed())
        self._show = gui.add_dropdown("Show", tuple(c.name for c in self._choices))
        self._show.visible = len(self._choices) > 1
        self._layer = gui.add_dropdown("Layer", self._layers())
        self._legend = gui.add_image(np.zeros((10, 256, 3), np.uint8), format="png", visible=False)
        self._meaning = gui.add_markdown("", visible=False)
        self._fly = gui.add_checkbox("Fly along", False, hint="Look from where the capture's camera was.")
        self._tracks = gui.add_checkbox("Tracks", False, hint="Where things go; what is to come is faint.")
        self._cameras = gui.add_checkbox("Cameras", False, hint="Click one to look from there; orange are held out.")
        for control in (self._show, self._fly, self._tracks):
            control.on_update(lambda _: self._changed())
        self._layer.on_update(lambda _: self._layer_chosen())
        self._cameras.on_update(lambda _: self._show_frustums())
        gui.add_button("Back to the start", icon=viser.Icon.HOME).on_click(
            lambda event: self._go_to(self._first.frames[0], event.client)
        )
        self._status = gui.add_markdown("")
        with gui.add_folder("Keys", expand_by_default=False):
            gui.add_markdown(KEYS)

    def _set_keys(self) -> None:
        def advance(menu: Any) -> Callable[[Any], None]:
            def advanced(_: Any) -> None:
                options = list(menu.options)
                menu.value = options[(options.index(menu.value) + 1) % len(options)]

            return advanced

        def toggle(box: Any) -> Callable[[Any], None]:
            def toggled(_: Any) -> None:
                box.value = not box.value

            return toggled

        keys: list[tuple[str, Any, Callable[[Any], None]]] = [
            ("Play or pause", "space", lambda _: self._toggle_play()),
            ("Next frame", "N", lambda _: self._step(1)),
            ("Previous frame", "B", lambda _: self._step(-1)),
            ("Fly along", "F", toggle(self._fly)),
            ("Tracks", "T", toggle(self._tracks)),
            ("Next layer", "L", advance(self._layer)),
            ("Next view", "V", advance(self._show)),
        ]
        for label, key, act in keys:
            self.server.gui.add_command(label, hotkey=key).on_trigger(act)

    def _layers(self) -> tuple[str, ...]:
        """Those that any of the models has."""
        return tuple(n for n in LAYER_NAMES if any(n not in shown.lacking for shown in self.drawing.shown))

    def _about(self) -> str:
        lines = []
        for index, shown in enumerate(self.drawing.shown):
            method, units = title_of(shown.loaded.method), len(shown.loaded.model)
            lines.append(f"**{shown.name}**: {method}, {units:,} units; {shown.state}")
            if index in self._troubles:
                lines.append(self._troubles[index])
        return "\n\n".join(lines)

    # What a person does.

    def _scrubbed(self, event: Any) -> None:
        if event.client is not None:  # else it was us, as time went on
            now = time.monotonic()
            self._playing = self._playing.run(now, is_running=False).moved_to(now, self._time.value)
            self._changed()

    def _toggle_play(self) -> None:
        self._playing = self._playing.run(time.monotonic(), is_running=not self._playing.is_running)
        self._changed()

    def _set_speed(self) -> None:
        self._playing = self._playing.at_speed(time.monotonic(), SPEEDS[self._speed.value])
        self._changed()

    def _step(self, steps: int) -> None:
        now = time.monotonic()
        frame = frame_after(self._first.frames, self._playing.at(now), steps)
        self._playing = self._playing.run(now, is_running=False).moved_to(now, frame.time_s)
        self._changed()

    def _layer_chosen(self) -> None:
        if self._layer.value in OF_FOOTAGE:
            self._fly.value = True
        self._changed()

    def _changed(self) -> None:
        """Whatever a person has changed: the panel shows it, and every window is drawn anew."""
        running = self._playing.is_running
        self._play.label = "Pause" if running else "Play"
        self._play.icon = viser.Icon.PLAYER_PAUSE if running else viser.Icon.PLAYER_PLAY
        self._show_frustums()
        self._texts_at = 0.0
        self._show_time()
        self.drawing.look_again()

    def _show_time(self) -> None:
        self._time.value = round(self._playing.at(time.monotonic()), 3)

    # Cameras.

    @property
    def _first(self) -> LoadedModel:
        return self.drawing.shown[0].loaded

    def _at_frame(self, frame: Frame, aspect: float) -> Eye:
        return Eye(frame.viewmat, fov_that_shows(self._first.camera, aspect))

    def _set_camera(self) -> None:
        """Every browser begins where the first frame was taken."""
        frame, unit_m = self._first.frames[0], self._first.frame.unit_m
        eye = self._at_frame(frame, 16 / 9)
        start = self.server.initial_camera
        start.up, start.fov = (0.0, 0.0, 1.0), eye.fov
        start.near, start.far = 1e-3 * unit_m, 1e3 * unit_m
        start.position, start.look_at = eye.center(), to_orbit(eye, self._middle(eye, frame.time_s))

    def _middle(self, eye: Eye, second: float) -> Array:
        """[3] metres, what is in the middle of a picture, to orbit around."""
        point = point_under(self.drawing.shown, Wanted(eye, 1.0, second), 0.5, 0.5)
        return eye.center() + self._first.frame.unit_m * eye.ahead() if point is None else point

    def _arrive(self, client: viser.ClientHandle) -> None:
        camera = client.camera
        size = (camera.image_width, camera.image_height)
        seat = Seat(client, Ride(self.drawing.shown[0]), self._at_frame(self._first.frames[0], size[0] / size[1]), size)
        seat.place(seat.eye)
        self._seats[client.client_id] = seat
        camera.on_update(lambda camera: self._moved(seat, camera))
        camera.fov = seat.eye.fov
        self.drawing.open(client.client_id, lambda now: self.wanted(seat, now), lambda sent: self._send(seat, sent))

    def _leave(self, client: viser.ClientHandle) -> None:
        self.drawing.close(client.client_id)
        self._seats.pop(client.client_id, None)

    def _moved(self, seat: Seat, camera: viser.CameraHandle) -> None:
        """A browser tells where its camera is: where a person took it, or where we put it."""
        if min(camera.image_width, camera.image_height) > 0:
            seat.size = (camera.image_width, camera.image_height)
        eye = Eye(viewmat_of(camera.wxyz, camera.position), camera.fov)
        if self._fly.value and seat.ride.is_echo(eye):
            return
        self._fly.value = False
        seat.moved(eye, SAME_PLACE * self._first.frame.unit_m)
        self.drawing.look_again()

    def _put(self, seat: Seat, eye: Eye, look_at: Array) -> None:
        """Move the browser's own camera, from which a person then orbits."""
        seat.place(eye)
        with seat.client.atomic():
            camera = seat.client.camera
            camera.position, camera.look_at, camera.fov = eye.center(), to_orbit(eye, look_at), eye.fov

    def _go_to(self, frame: Frame, client: viser.ClientHandle | None) -> None:
        """Look at the second of a frame from where it was taken."""
        seat = None if client is None else self._seats.get(client.client_id)
        now = time.monotonic()
        self._playing = self._playing.run(now, is_running=False).moved_to(now, frame.time_s)
        if seat is not None:
            self._fly.value = False
            eye = self._at_frame(frame, seat.aspect)
            self._put(seat, eye, self._middle(eye, frame.time_s))
        self._changed()

    def _orbit_point(self, event: Any) -> None:
        seat = self._seats.get(event.client_id)
        if seat is None:
            return
        point = point_under(self.drawing.shown, self.wanted(seat, time.monotonic())[0], *event.screen_pos)
        if point is not None:
            self._fly.value = False
            seat.client.camera.look_at = point

    def _set_frustums(self) -> None:
        loaded = self._first
        camera = loaded.camera
        chosen = np.linspace(0, len(loaded.frames) - 1, min(len(loaded.frames), MOST_FRUSTUMS)).round().astype(int)
        self._frustums = []
        for frame in (loaded.frames[i] for i in chosen):
            frustum = self.server.scene.add_camera_frustum(
                f"/cameras/{frame.name}",
                fov=2 * float(np.arctan(camera.height / 2 / camera.K[1, 1])),
                aspect=camera.width / camera.height,
                scale=FRUSTUM * loaded.frame.unit_m,
                thickness=2.0,
                thickness_units="screen",
                color=HELD_OUT if frame.split == "test" else TRAINING,
                wxyz=wxyz_of(frame.viewmat),
                position=Eye(frame.viewmat, 1.0).center(),
                visible=False,
            )
            frustum.on_click(self._goes_to(frame))
            self._frustums.append(frustum)

    def _goes_to(self, frame: Frame) -> Callable[[Any], None]:
        return lambda event: self._go_to(frame, event.client)

    def _show_frustums(self) -> None:
        """Where the window is one picture: in a part of it they would stand elsewhere."""
        visible = self._cameras.value and self.choice.arrangement != SIDE_BY_SIDE
        for frustum in self._frustums:
            frustum.visible = visible

    # Pictures on their way.

    def _send(self, seat: Seat, sent: Sent) -> None:
        if seat.client.client_id not in self._seats:  # it has just left
            return
        pixels = sent.picture.pixels
        is_sharp = pixels.shape[1::-1] == seat.size
        seat.client.scene.set_background_image(
            pixels, format="jpeg", jpeg_quality=SHARP_QUALITY if is_sharp else COARSE_QUALITY
        )
        seat.client.flush()
        if self._fly.value and sent.eye is not seat.eye:
            seat.ride.sent(sent.eye)
            self._put(seat, sent.eye, sent.eye.center() + self._first.frame.unit_m * sent.eye.ahead())
        now = time.monotonic()
        if now - self._texts_at >= SECONDS_BETWEEN_TEXTS or is_sharp:
            self._texts_at = now
            self._tell(sent)

    def _tell(self, sent: Sent) -> None:
        self._show_time()
        picture = sent.picture
        height, width = picture.pixels.shape[:2]
        self._status.content = "\n\n".join([f"{width} x {height}, {sent.seconds * 1e3:.0f} ms", *picture.notes])
        if picture.scale is self._scale:
            return
        self._scale = picture.scale
        self._legend.visible = self._meaning.visible = picture.scale is not None
        if picture.scale is not None:
            self._legend.image = legend(picture.scale)
            self._meaning.content = meaning(picture.scale)


def meaning(scale: Scale) -> str:
    """What the ends of a scale stand for."""
    lower, upper = scale.bounds
    unit = f" {scale.ramp.unit}" if scale.ramp.unit else ""
    return f"{scale.ramp.meaning}: {lower:.3g} to {upper:.3g}{unit}"

"""The 3D scene: robot, estimate, truth, map, camera; updated in a thread of its own at a bounded rate."""

import threading
from collections import deque
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import viser

from server.background import attempt
from server.body import USUAL_PERIOD_S, body_links, heading_rad, mean_path
from server.view import View
from server.viewer_host import start_viser, stop_viser
from snakeslam.geometry import so3
from snakeslam.mapping.detail import coarse_to_fine
from snakeslam.messages import Float, MapChunk
from snakeslam.runtime.bus.topics import JpegImage, Opening, Report, RobotShape, Started, Tick

RATE_HZ = 15.0
PATH_RATE_HZ = 2.0
IMAGE_RATE_HZ = 5.0
MAX_PATH_POINTS = 2000
POINT_SIZE_M = 0.016
FRUSTUM_SCALE_M = 0.12
BODY_RGB, DARK_RGB, HEAD_RGB = (200, 112, 24), (128, 70, 14), (255, 210, 60)
ESTIMATE_RGB, TRUTH_RGB = (69, 201, 181), (200, 208, 213)
NEW_MAP_RGB, NEW_MAP_SHARE = (240, 165, 40), 0.6
"""A map that is not connected to the first one: the colour of its path, and how much of it its points take."""
PATHS = {"estimate": (ESTIMATE_RGB, 2.0), "truth": (TRUTH_RGB, 1.0), "new_map": (NEW_MAP_RGB, 3.0)}
AIM_STEP_M = 0.25
VIEW_FROM_M = np.array([-1.2, -1.8, 1.7])
"""From the middle of the body: the whole of a robot of 3.2 m fits in, and what lies before it."""
PATH_HEIGHT_M = -0.06
"""Height of the paths against the head's: above the floor, below the body."""
IDENTITY = (1.0, 0.0, 0.0, 0.0)


def capsule_mesh(length_m: float, radius_m: float, sides: int = 12) -> tuple[Float, np.ndarray[Any, Any]]:
    """Return vertices (V, 3) and faces (F, 3) of a link along x from 0 to ``length_m``, its ends rounded off."""
    rings = [(0.0, 0.35), (0.06, 0.85), (0.2, 1.0), (0.8, 1.0), (0.94, 0.85), (1.0, 0.35)]
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    body = [np.column_stack([np.full(sides, x * length_m), circle * r * radius_m]) for x, r in rings]
    vertices = np.concatenate([*body, [[0.0, 0.0, 0.0], [length_m, 0.0, 0.0]]])
    k = np.arange(sides)
    after = (k + 1) % sides
    faces: list[np.ndarray[Any, Any]] = []
    for ring in range(len(rings) - 1):
        a, b = ring * sides, (ring + 1) * sides
        faces += [np.column_stack([a + k, a + after, b + k]), np.column_stack([a + after, b + after, b + k])]
    rear, front, last = len(vertices) - 2, len(vertices) - 1, (len(rings) - 1) * sides
    faces += [np.column_stack([np.full(sides, rear), after, k])]
    faces += [np.column_stack([np.full(sides, front), last + k, last + after])]
    return vertices, np.concatenate(faces)


def arrow_mesh() -> tuple[Float, np.ndarray[Any, Any]]:
    """Return vertices (7, 3) and faces (3, 3) of a flat arrow along x, 0.6 m long, that begins at the origin."""
    outline = [(0.0, -0.03), (0.36, -0.03), (0.36, 0.03), (0.0, 0.03), (0.36, -0.11), (0.6, 0.0), (0.36, 0.11)]
    vertices = np.column_stack([np.array(outline), np.zeros(len(outline))])
    return vertices, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]])


def path_segments(points: Float) -> Float:
    """Return the path (N, 3) as segments (K, 2, 3), thinned to MAX_PATH_POINTS at even distances along it.

    Not at even times: a stationary robot would take the points away from where it moved, and leave polygons there.
    """
    along_m = np.r_[0.0, np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()]
    if len(points) > MAX_PATH_POINTS:
        kept = np.searchsorted(along_m, np.linspace(0.0, along_m[-1], MAX_PATH_POINTS))
        points = points[np.unique([*kept, len(points) - 1])]
    return np.stack([points[:-1], points[1:]], axis=1)


def tinted(chunk: MapChunk) -> np.ndarray[Any, Any]:
    """Return the colours (N, 3) uint8 of a chunk's points, tinted where its map is not connected to the first one."""
    if chunk.island == 0:
        return chunk.rgb
    tint = np.asarray(NEW_MAP_RGB, dtype=np.float32)
    return ((1.0 - NEW_MAP_SHARE) * chunk.rgb + NEW_MAP_SHARE * tint).astype(np.uint8)


class Scene:
    """The nodes of one session's scene; node names are reused, so that messages replace each other."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._scene = server.scene
        self._robot: viser.BatchedMeshHandle | None = None
        self._heading: viser.MeshHandle | None = None
        self._camera: viser.CameraFrustumHandle | None = None
        self._paths: dict[str, viser.LineSegmentsHandle] = {}
        self._chunks: dict[int, viser.PointCloudHandle] = {}
        self._camera_T_IC: Float = np.eye(4)
        self._aimed_at_W: Float = np.full(3, np.inf)
        self._aim(np.zeros(3))
        self._furnish()

    def reset(self, started: Started | None) -> None:
        """Clear the scene and set up what a session draws."""
        for handle in (self._robot, self._heading, self._camera, *self._paths.values(), *self._chunks.values()):
            if handle is not None:
                handle.remove()
        self._robot = self._heading = self._camera = None
        self._paths, self._chunks = {}, {}
        self._aim(np.zeros(3))
        if started is None:
            return
        self._camera_T_IC = started.T_IC
        self._camera = self._scene.add_camera_frustum(
            "/camera",
            fov=started.fov_y_rad,
            aspect=started.aspect,
            scale=FRUSTUM_SCALE_M,
            thickness=0.003,
            color=HEAD_RGB,
            visible=False,
        )
        if started.robot is not None:
            self._robot = self._add_robot(started.robot)
            self._heading = self._add_heading()

    def show_tick(self, tick: Tick, Ts_WL: Float | None) -> None:
        """Pose the robot, links ``Ts_WL`` (N + 1, 4, 4), its heading and the camera."""
        with self._server.atomic():
            if Ts_WL is not None:
                self._aim(np.mean(Ts_WL[:, :3, 3], axis=0))
                self._show_body(tick, Ts_WL)
            if self._camera is not None and tick.T_WI is not None:
                if Ts_WL is None:
                    self._aim(tick.T_WI[:3, 3])
                T_WC = tick.T_WI @ self._camera_T_IC
                self._camera.position = T_WC[:3, 3]
                self._camera.wxyz = so3.quat_wxyz_from_matrix(T_WC[:3, :3])
                self._camera.visible = True

    def _show_body(self, tick: Tick, Ts_WL: Float) -> None:
        if self._robot is None or self._heading is None:
            return
        self._robot.batched_positions = Ts_WL[:, :3, 3].astype(np.float32)
        self._robot.batched_wxyzs = so3.quat_wxyz_from_matrix(Ts_WL[:, :3, :3]).astype(np.float32)
        yaw_rad = heading_rad(tick, Ts_WL)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
        self._heading.position = Ts_WL[-1, :3, 3] + 0.16 * ahead
        self._heading.wxyz = (np.cos(yaw_rad / 2.0), 0.0, 0.0, np.sin(yaw_rad / 2.0))
        self._robot.visible = self._heading.visible = True

    def _aim(self, p_W: Float) -> None:
        """Let new viewers, and "reset view", look at where the robot is now."""
        if np.linalg.norm(p_W - self._aimed_at_W) > AIM_STEP_M:
            self._aimed_at_W = p_W
            self._server.initial_camera.position = p_W + VIEW_FROM_M
            self._server.initial_camera.look_at = p_W

    def show_image(self, image: JpegImage) -> None:
        """Show the image in the frustum, as it came: no second encoding."""
        if self._camera is not None:
            self._camera._format = "jpeg"  # pyright: ignore[reportPrivateUsage]
            self._camera._image_data = image.jpeg  # pyright: ignore[reportPrivateUsage]

    def show_path(self, name: str, rows: list[tuple[float, float, float, float]], period_s: float) -> None:
        """Draw a trajectory, averaged over the gait's period: a swinging head's own path would hide the body."""
        if len(rows) < 2:
            if not rows and name in self._paths:
                self._paths.pop(name).remove()
            return
        path = mean_path(rows, period_s) + np.array([0.0, 0.0, PATH_HEIGHT_M])
        segments = path_segments(path).astype(np.float32)
        line = self._paths.get(name)
        if line is not None:
            line.points = segments
            return
        colour, width = PATHS[name]
        self._paths[name] = self._scene.add_line_segments(
            f"/{name}", segments, colour, thickness=width, thickness_units="screen"
        )

    def show_chunk(self, chunk: MapChunk) -> None:
        """Draw a chunk of the map; its points keep half precision because they are near their keyframe."""
        if len(chunk.points_K) == 0:
            return
        # A browser draws the first part of a chunk that is far away, or of all while it is slow: web/src/scene.ts.
        order = coarse_to_fine(np.asarray(chunk.points_K, dtype=np.float64))
        self._chunks[chunk.key] = self._scene.add_point_cloud(
            f"/map/{chunk.key}",
            chunk.points_K[order],
            tinted(chunk)[order],
            point_size=POINT_SIZE_M,
            point_shading="flat",
            precision="float16",
            position=chunk.T_WK[:3, 3],
            wxyz=so3.quat_wxyz_from_matrix(chunk.T_WK[:3, :3]),
        )

    def _furnish(self) -> None:
        # Its three shadow maps cost a browser without a graphics card more than all else it draws.
        self._scene.configure_default_lights(cast_shadow=False)
        # Nor is there any light from surroundings: blurring their image stops such a browser for ten seconds.
        self._scene.configure_environment_map(None)
        self._scene.add_grid(
            "/grid",
            width=40.0,
            height=40.0,
            plane="xy",
            cell_size=0.5,
            section_size=1.0,
            cell_color=(34, 38, 44),
            section_color=(56, 62, 70),
            position=(0.0, 0.0, -0.12),
        )
        self._scene.world_axes.visible = False

    def _add_heading(self) -> viser.MeshHandle:
        vertices, faces = arrow_mesh()
        return self._scene.add_mesh_simple(
            "/heading", vertices, faces, color=HEAD_RGB, material="standard", side="double", visible=False
        )

    def _add_robot(self, shape: RobotShape) -> viser.BatchedMeshHandle:
        vertices, faces = capsule_mesh(shape.joint_length_m, shape.radius_m)
        links = shape.joint_count + 1
        colours = np.array([BODY_RGB if k % 2 else DARK_RGB for k in range(links - 1)] + [HEAD_RGB], dtype=np.uint8)
        return self._scene.add_batched_meshes_simple(
            "/robot",
            vertices,
            faces,
            batched_wxyzs=np.tile(IDENTITY, (links, 1)),
            batched_positions=np.zeros((links, 3)),
            batched_colors=colours,
            lod="off",
            side="double",
            visible=False,
        )


class Viewer:
    """Owns the viser server and the thread that draws; reports are handed over without waiting."""

    def __init__(self, path: Path) -> None:
        self.server = start_viser(path)
        self._scene = Scene(self.server)
        self._lock = threading.Lock()
        self._wanted: Started | None = None
        self._fresh = False
        self._tick: Tick | None = None
        self._image: JpegImage | None = None
        self._chunks: deque[MapChunk] = deque()
        self._view: View | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._draw_all, name="viewer", daemon=True)
        self._thread.start()

    def on_report(self, report: Report, view: View) -> None:
        """Take a report of the session."""
        with self._lock:
            self._view = view
            if isinstance(report, Started | Opening):
                self._wanted, self._fresh = report if isinstance(report, Started) else None, True
                self._tick = self._image = None
                self._chunks.clear()
            elif isinstance(report, Tick):
                self._tick = report
            elif isinstance(report, JpegImage):
                self._image = report
            elif isinstance(report, MapChunk):
                self._chunks.append(report)

    def close(self) -> None:
        """Stop drawing and serving."""
        self._stop.set()
        self._thread.join(2.0)
        stop_viser(self.server)

    def _draw_all(self) -> None:
        rounds = 0
        while not self._stop.wait(1.0 / RATE_HZ):
            paths = rounds % round(RATE_HZ / PATH_RATE_HZ) == 0
            image = rounds % round(RATE_HZ / IMAGE_RATE_HZ) == 0
            attempt("drawing the view", partial(self._draw, paths=paths, image=image))
            rounds += 1

    def _draw(self, *, paths: bool, image: bool) -> None:
        with self._lock:
            fresh, self._fresh = self._fresh, False
            tick, self._tick = self._tick, None
            shown = self._image if image else None
            if image:
                self._image = None
            chunks, self._chunks = self._chunks, deque()
            view, wanted = self._view, self._wanted
        if fresh:
            self._scene.reset(wanted)
        for chunk in chunks:
            # One that cannot be drawn takes no other along.
            attempt(f"drawing map chunk {str(chunk.key)[:40]}", partial(self._scene.show_chunk, chunk))
        if tick is not None:
            self._scene.show_tick(tick, None if view is None else body_links(view, tick))
        if shown is not None:
            self._scene.show_image(shown)
        if paths and view is not None:
            last = view.tick
            period_s = (None if last is None else last.head.window_s) or USUAL_PERIOD_S
            self._scene.show_path("estimate", list(view.estimate.rows), period_s)
            self._scene.show_path("truth", list(view.truth.rows), period_s)
            self._scene.show_path("new_map", list(view.new_map.rows), period_s)

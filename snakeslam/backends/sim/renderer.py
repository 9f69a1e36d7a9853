"""Draws what the simulated camera's optics see: a pinhole image with its depth, in OpenGL without a window."""

import sys
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from snakeslam.backends.sim import meshes
from snakeslam.backends.sim.meshes import Mesh
from snakeslam.backends.sim.scenery import World
from snakeslam.backends.sim.textures import Texture
from snakeslam.errors import BackendError
from snakeslam.geometry import se3
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

WIDTH_PX, HEIGHT_PX = 640, 480
NEAR_M, FAR_M = 0.04, 30.0
"""Where the image is cut off; the depth buffer has 24 bits, so a step is z^2 / (2^24 near): 6 um at 2 m."""
LIGHT_W = (0.4, 0.3, 1.0)
AMBIENT, DIFFUSE = 0.75, 0.4
"""Light from everywhere, more from where ``LIGHT_W`` points and less from behind: no side is black."""
SKY, BODY = (178, 178, 204), (150, 152, 160)
BODY_SIDES = 20
LIBRARIES: dict[str, Any] = {"libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
"""The names without which EGL would be looked for in the packages for developers."""

VERTEX_SHADER = """
#version 330
uniform mat4 clip_W;
uniform vec3 light_W;
uniform vec2 ambient_diffuse;
in vec3 vertex;
in vec3 normal;
in vec2 uv;
in mat4 pose_W;
out vec2 texture_uv;
out float shade;
void main() {
    gl_Position = clip_W * pose_W * vec4(vertex, 1.0);
    texture_uv = uv;
    shade = ambient_diffuse.x + ambient_diffuse.y * dot(mat3(pose_W) * normal, light_W);
}
"""
FRAGMENT_SHADER = """
#version 330
uniform sampler2D image;
in vec2 texture_uv;
in float shade;
out vec4 colour;
void main() {
    colour = vec4(shade * texture(image, texture_uv).rgb, 1.0);
}
"""

Image = NDArray[np.uint8]
Depth = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Render:
    """What the optics see at one instant: ``rgba`` (H, W, 4), ``inverse_depth`` (H, W) float32 1/m."""

    rgba: Image
    inverse_depth: Depth


@dataclass(frozen=True, slots=True)
class _Piece:
    """Meshes that wear one texture, as often as there are poses."""

    texture: moderngl.Texture
    shape: moderngl.VertexArray
    count: int


class Renderer:
    """Draws a world and a snake's links for a pinhole of focal length ``f_px``, centred in the image.

    BackendError where there is no OpenGL. To be used from the thread that made it.
    """

    def __init__(self, world: World, model: SnakeModel, f_px: float) -> None:
        self._context = _context()
        with self._context:
            self._program = self._context.program(vertex_shader=VERTEX_SHADER, fragment_shader=FRAGMENT_SHADER)
            self._set("light_W", np.asarray(LIGHT_W) / np.linalg.norm(LIGHT_W))
            self._set("ambient_diffuse", np.array([AMBIENT, DIFFUSE]))
            here = self._context.buffer(_columns(np.eye(4)[None]))
            self._links_W = self._context.buffer(reserve=model.link_count * 64, dynamic=True)
            self._pieces = [self._piece(image, meshes.merge(shapes), here, 1) for image, shapes in world.surfaces]
            body = meshes.cylinder(model.radius_m, 0.05 * model.joint_length_m, 0.95 * model.joint_length_m, BODY_SIDES)
            self._pieces.append(self._piece(np.full((1, 1, 3), BODY, np.uint8), body, self._links_W, model.link_count))
            size_px = (WIDTH_PX, HEIGHT_PX)
            self._depth = self._context.depth_texture(size_px)
            self._frame = self._context.framebuffer([self._context.renderbuffer(size_px, 4)], self._depth)
        self._projection = projection_matrix(f_px)

    def render(self, T_WC: Float, Ts_WL: Float) -> Render:
        """Return the image from the camera's pose (4, 4), optical frame, with the links at (L, 4, 4)."""
        with self._context as context:
            # The first row read back is the lowest on OpenGL's screen, so the image is drawn upside down, and the
            # faces are seen turning the other way.
            context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
            context.front_face = "cw"
            self._set("clip_W", (self._projection @ se3.inv(T_WC)).T)
            self._links_W.write(_columns(Ts_WL))
            self._frame.use()
            self._frame.clear(SKY[0] / 255.0, SKY[1] / 255.0, SKY[2] / 255.0)
            for piece in self._pieces:
                piece.texture.use()
                piece.shape.render(instances=piece.count)
            rgba = np.frombuffer(self._frame.read(components=4), np.uint8)
            buffer = np.frombuffer(self._depth.read(), np.float32)
        inverse_depth = 1.0 / NEAR_M - buffer * np.float32(1.0 / NEAR_M - 1.0 / FAR_M)
        return Render(rgba.reshape(HEIGHT_PX, WIDTH_PX, 4), inverse_depth.reshape(HEIGHT_PX, WIDTH_PX))

    def close(self) -> None:
        """Release OpenGL; to be called once."""
        self._context.release()

    def _set(self, name: str, value: Float) -> None:
        uniform = self._program[name]
        assert isinstance(uniform, moderngl.Uniform)
        uniform.write(np.asarray(value, np.float32).tobytes())

    def _piece(self, image: Texture, mesh: Mesh, poses: moderngl.Buffer, count: int) -> _Piece:
        corners = np.hstack([mesh.vertices_W, mesh.normals_W, mesh.uvs]).astype(np.float32)
        content = [
            (self._context.buffer(corners.tobytes()), "3f 3f 2f", "vertex", "normal", "uv"),
            (poses, "16f/i", "pose_W"),
        ]
        indices = self._context.buffer(mesh.triangles.astype(np.int32).tobytes())
        return _Piece(self._texture(image), self._context.vertex_array(self._program, content, indices), count)

    def _texture(self, image: Texture) -> moderngl.Texture:
        height, width = image.shape[:2]
        texture = self._context.texture((width, height), 3, np.ascontiguousarray(image[::-1]).tobytes(), alignment=1)
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        return texture


def projection_matrix(f_px: float) -> Float:
    """Return OpenGL's projection (4, 4) from the optical frame: z ahead, y down, the image upside down."""
    P = np.zeros((4, 4))
    P[0, 0], P[1, 1] = 2.0 * f_px / WIDTH_PX, 2.0 * f_px / HEIGHT_PX
    P[2, 2], P[2, 3] = (FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)
    P[3, 2] = 1.0
    return P


def _context() -> moderngl.Context:
    """Return a context of its own without a window."""
    try:
        if sys.platform == "linux":
            # moderngl's own types leave its settings out.
            settings: Any = {"backend": "egl", **LIBRARIES}
            return moderngl.create_context(require=330, standalone=True, **settings)
        return moderngl.create_context(require=330, standalone=True)
    except Exception as error:  # moderngl raises plain exceptions
        needed = "Debian: libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri"
        raise BackendError(f"the simulator's camera needs OpenGL 3.3 without a window ({needed}): {error}") from error


def _columns(matrices: Float) -> bytes:
    """Return matrices (..., 4, 4) as OpenGL keeps them, column by column."""
    return np.ascontiguousarray(np.swapaxes(matrices, -1, -2), dtype=np.float32).tobytes()

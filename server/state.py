"""The session's reports in the words of the HTTP contract."""

import json
import math
import struct
from dataclasses import asdict
from typing import Any

import numpy as np

from server.body import body_links, heading_rad
from server.lease import Desk
from server.live import Live, View
from snakeslam.gaits.catalogue import PARAMETER_KINDS
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import Float, GaitCommand, Health, Verdict
from snakeslam.robot.model import snake_model
from snakeslam.runtime.bus.topics import Event, Features, Governed, HeadMotion, Picture, PlaybackState, Tick

FRAME = b"\x01"
Json = dict[str, Any]


def gait_json(gait: GaitCommand) -> Json:
    """A gait with its parameters; None for those at the gait's own default."""
    return {
        "name": gait.gait,
        "drive": gait.drive,
        "turn": gait.turn,
        **{key: gait.parameters.get(key) for key in PARAMETER_KINDS},
    }


def head_control_json(head: HeadSettings | None) -> Json | None:
    """The head settings in force; None without a robot."""
    return None if head is None else {"controller": head.controller, "neck_joints": head.neck_joints}


def head_json(head: HeadMotion) -> Json:
    """How still the head is."""
    return {key: _round(value, 4) for key, value in asdict(head).items()}


def control_json(desk: Desk) -> Json:
    """Who may move the robot; ``id`` and ``holder`` are None while nobody may."""
    lease = desk.lease
    return {"id": None, "holder": None} if lease is None else {"id": lease.id, "holder": lease.holder}


def state_json(live: Live, desk: Desk) -> Json:
    """GET /state."""
    view, started, tick = live.view, live.view.started, live.view.tick
    return {
        "source": {"kind": view.kind, "name": view.name},
        "t_s": 0.0 if tick is None else round(view.t_s(tick.t_ns), 4),
        "moving": live.moving,
        "estop": {"latched": live.estop_reason is not None, "reason": live.estop_reason},
        "control": control_json(desk),
        "gait": gait_json(live.gait()),
        "notice": None if tick is None else tick.notice,
        "held_because": None if tick is None else tick.held_because,
        "back_up_offered": tick is not None and tick.back_up_offered,
        "head_control": head_control_json(live.head()),
        "head": head_json(HeadMotion() if tick is None else tick.head),
        "robot": _robot_json(view),
        "estimator": {"mode": view.config.estimator.mode if started is None else started.estimator_mode},
        "health": _health_json(Health(Verdict.INITIALISING) if tick is None else tick.health),
        "realtime_factor": _round(None if tick is None else tick.realtime_factor, 3),
        "session": view.phase,
        "session_number": view.number,
        "message": view.message,
        "playback": None if tick is None else playback_json(tick.playback),
    }


def playback_json(playback: PlaybackState | None) -> Json | None:
    """How a recording plays; None for a robot."""
    return None if playback is None else {key: _rounded(value) for key, value in asdict(playback).items()}


def _rounded(value: float) -> float:
    """Cut a time off at 0.1 ms; a flag or a count stays what it is."""
    return round(value, 4) if isinstance(value, float) else value


def _robot_json(view: View) -> Json:
    if view.kind == "recording":
        return {"model": "none", "joints": 0}
    model = snake_model(view.config.robot)
    return {"model": model.name, "joints": model.joint_count}


def tick_json(view: View, tick: Tick) -> Json:
    """A tick of /telemetry."""
    return {
        "type": "tick",
        "t_s": round(view.t_s(tick.t_ns), 4),
        "realtime_factor": _round(tick.realtime_factor, 3),
        "frame_rate_hz": _round(tick.frame_rate_hz, 2),
        "q_target": _angles(tick.q_target_rad),
        "q_measured": _angles(tick.q_measured_rad),
        "moving": tick.moving,
        "drive": 0.0 if tick.gait is None else tick.gait.drive,
        "turn": 0.0 if tick.gait is None else tick.gait.turn,
        "estop": {"latched": tick.estop_reason is not None, "reason": tick.estop_reason},
        "notice": tick.notice,
        "head_control": head_control_json(tick.head_settings),
        "head": head_json(tick.head),
        "health": _health_json(tick.health),
        "governor": _governor_json(tick.governed),
        "error_m": _round(tick.error_m, 5),
        "distance_m": _round(tick.distance_m, 4),
        "map_points": tick.map_points,
        "body": body_json(view, tick),
        "playback": playback_json(tick.playback),
    }


def body_json(view: View, tick: Tick) -> Json | None:
    """The body in the world for the page's own drawing: where each link begins, tail to head, as x, y, z in turn.

    A recording without joints has a single point, where its IMU is.
    """
    Ts_WL = body_links(view, tick)
    if Ts_WL is None and tick.T_WI is not None:
        Ts_WL = tick.T_WI[None]
    if Ts_WL is None:
        return None
    points = np.round(Ts_WL[:, :3, 3], 3).ravel().tolist()
    heading_deg = math.degrees(heading_rad(tick, Ts_WL))
    return {"p_m": points, "heading_deg": round(heading_deg, 1), "estimated": tick.T_WI is not None}


def event_json(view: View, event: Event) -> Json:
    """An event of /telemetry."""
    t_s = round(view.t_s(event.t_ns), 4)
    return {"type": "event", "t_s": max(t_s, 0.0), "level": event.level, "text": event.text}


def picture_bytes(view: View, picture: Picture) -> bytes:
    """A camera frame of /telemetry: kind, header length, header, JPEG."""
    header = {
        "t_s": round(view.t_s(picture.t_ns), 4),
        "seq": picture.seq,
        "width": picture.width,
        "height": picture.height,
    }
    text = json.dumps(header, separators=(",", ":")).encode()
    return FRAME + struct.pack("<I", len(text)) + text + picture.jpeg


def features_json(view: View, features: Features) -> Json:
    """The features followed into a frame, and how far the camera was rolled then, of /telemetry."""
    return {
        "type": "features",
        "t_s": round(view.t_s(features.t_ns), 4),
        "seq": features.seq,
        "tracks": features.tracks,
        "roll_deg": None if features.roll_rad is None else round(math.degrees(features.roll_rad), 1),
    }


def _health_json(health: Health) -> Json:
    return {
        "verdict": health.verdict.value,
        "reasons": list(health.reasons),
        "tracks": health.tracks,
        "map_connected": health.map_connected,
    }


def _governor_json(governed: Governed | None) -> Json | None:
    """What the governor allows; None where it is off."""
    if governed is None:
        return None
    return {"pace": round(governed.pace, 3), "phase": governed.phase.value, "reason": governed.reason}


def _angles(q_rad: Float | None) -> list[float]:
    return [] if q_rad is None else [round(q, 4) for q in q_rad.tolist()]


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)

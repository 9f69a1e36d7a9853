"""The session's reports as the models of the API."""

import math
import struct
from dataclasses import asdict

import numpy as np

from server import models
from server.body import body_links, heading_rad
from server.lease import Desk
from server.live import Live
from server.view import View
from snakeslam.gaits.catalogue import PARAMETER_KINDS
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import Float, GaitCommand, Health, Verdict
from snakeslam.robot.model import snake_model
from snakeslam.runtime.bus.topics import Event, Features, Governed, HeadMotion, JpegImage, PlaybackState, Tick

FRAME = b"\x01"


def gait_state(gait: GaitCommand) -> models.GaitState:
    """Return a gait with its parameters; None for those at the gait's own default."""
    parameters = {key: gait.parameters.get(key) for key in PARAMETER_KINDS}
    return models.GaitState.model_validate({"name": gait.gait, "drive": gait.drive, "turn": gait.turn, **parameters})


def head_control(head: HeadSettings | None) -> models.HeadControl | None:
    """Return the head settings in force; None without a robot."""
    return None if head is None else models.HeadControl(controller=head.controller, neck_joints=head.neck_joints)


def head_motion(head: HeadMotion) -> models.HeadMotion:
    """Return how still the head is."""
    return models.HeadMotion(**{key: _round(value, 4) for key, value in asdict(head).items()})


def control(desk: Desk) -> models.Control:
    """Return who may move the robot; ``id`` and ``holder`` are None while nobody may."""
    lease = desk.lease
    return models.Control(id=None, holder=None) if lease is None else models.Control(id=lease.id, holder=lease.holder)


def state(live: Live, desk: Desk) -> models.State:
    """Return the answer of GET /state."""
    view, started, tick = live.view, live.view.started, live.view.tick
    return models.State(
        source=models.Source(kind=view.kind, name=view.name),
        t_s=0.0 if tick is None else round(view.t_s(tick.t_ns), 4),
        moving=live.moving,
        estop=models.EStopState(latched=live.estop_reason is not None, reason=live.estop_reason),
        control=control(desk),
        gait=gait_state(live.gait()),
        notice=None if tick is None else tick.notice,
        held_because=None if tick is None else tick.held_because,
        back_up_offered=tick is not None and tick.back_up_offered,
        head_control=head_control(live.head()),
        head=head_motion(HeadMotion() if tick is None else tick.head),
        robot=_robot(view),
        estimator=models.EstimatorInfo(mode=view.config.estimator.mode if started is None else started.estimator_mode),
        health=_health(Health(Verdict.INITIALISING) if tick is None else tick.health),
        realtime_factor=_round(None if tick is None else tick.realtime_factor, 3),
        session=view.phase,
        session_number=view.number,
        message=view.message,
        playback=None if tick is None else playback(tick.playback),
    )


def playback(found: PlaybackState | None) -> models.Playback | None:
    """Return how a recording plays, times cut off at 0.1 ms; None for a robot."""
    if found is None:
        return None
    values = {key: round(value, 4) if isinstance(value, float) else value for key, value in asdict(found).items()}
    return models.Playback.model_validate(values)


def _robot(view: View) -> models.RobotInfo:
    if view.kind == "recording":
        return models.RobotInfo(model="none", joints=0)
    model = snake_model(view.config.robot)
    return models.RobotInfo(model=model.name, joints=model.joint_count)


def tick_message(view: View, tick: Tick) -> models.Tick:
    """Return a tick of /telemetry."""
    return models.Tick(
        t_s=round(view.t_s(tick.t_ns), 4),
        realtime_factor=_round(tick.realtime_factor, 3),
        frame_rate_hz=_round(tick.frame_rate_hz, 2),
        q_target=_angles(tick.q_target_rad),
        q_measured=_angles(tick.q_measured_rad),
        moving=tick.moving,
        drive=0.0 if tick.gait is None else tick.gait.drive,
        turn=0.0 if tick.gait is None else tick.gait.turn,
        estop=models.EStopState(latched=tick.estop_reason is not None, reason=tick.estop_reason),
        notice=tick.notice,
        head_control=head_control(tick.head_settings),
        head=head_motion(tick.head),
        health=_health(tick.health),
        governor=_governor(tick.governed),
        error_m=_round(tick.error_m, 5),
        distance_m=_round(tick.distance_m, 4),
        map_points=tick.map_points,
        body=body(view, tick),
        playback=playback(tick.playback),
    )


def body(view: View, tick: Tick) -> models.Body | None:
    """Return the body in the world for the page's own drawing.

    A recording without joints has a single point, where its IMU is.
    """
    Ts_WL = body_links(view, tick)
    if Ts_WL is None and tick.T_WI is not None:
        Ts_WL = tick.T_WI[None]
    if Ts_WL is None:
        return None
    points = np.round(Ts_WL[:, :3, 3], 3).ravel().tolist()
    heading_deg = round(math.degrees(heading_rad(tick, Ts_WL)), 1)
    return models.Body(p_m=points, heading_deg=heading_deg, estimated=tick.T_WI is not None)


def timeline_event(view: View, event: Event) -> models.TimelineEvent:
    """Return an event of /telemetry."""
    t_s = max(round(view.t_s(event.t_ns), 4), 0.0)
    return models.TimelineEvent.model_validate({"t_s": t_s, "level": event.level, "text": event.text})


def image_bytes(view: View, image: JpegImage) -> bytes:
    """Return a camera image of /telemetry: kind, header length, header, JPEG."""
    t_s = round(view.t_s(image.t_ns), 4)
    header = models.ImageHeader(t_s=t_s, seq=image.seq, width=image.width, height=image.height)
    text = header.model_dump_json().encode()
    return FRAME + struct.pack("<I", len(text)) + text + image.jpeg


def features_message(view: View, features: Features) -> models.Features:
    """Return the features tracked into a frame, and how far the camera was rolled then, of /telemetry."""
    roll_deg = None if features.roll_rad is None else round(math.degrees(features.roll_rad), 1)
    t_s = round(view.t_s(features.t_ns), 4)
    return models.Features.model_validate(
        {"t_s": t_s, "seq": features.seq, "tracks": features.tracks, "roll_deg": roll_deg}
    )


def _health(health: Health) -> models.HealthState:
    return models.HealthState(
        verdict=health.verdict,
        reasons=list(health.reasons),
        tracks=health.tracks,
        map_connected=health.map_connected,
    )


def _governor(governed: Governed | None) -> models.Governor | None:
    """Return what the governor allows; None where it is off."""
    if governed is None:
        return None
    return models.Governor(pace=round(governed.pace, 3), phase=governed.phase, reason=governed.reason)


def _angles(q_rad: Float | None) -> list[float]:
    return [] if q_rad is None else [round(q, 4) for q in q_rad.tolist()]


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)

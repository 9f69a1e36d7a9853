// The HTTP contract with the server, as the page sees it. Units are in the names.

export interface GaitParameter {
  key: ParameterKey;
  label: string;
  unit: string;
  min: number;
  max: number;
  step: number;
  default: number;
}

export type ParameterKey = "alpha_pi" | "wavelength_joints" | "period_s" | "amplitude_deg";
export type ParameterValues = Partial<Record<ParameterKey, number | null>>;

export interface GaitEntry {
  name: string;
  title: string;
  summary: string;
  /** Whether it can be steered. */
  turns?: boolean;
  parameters: GaitParameter[];
}

export type GaitState = { name: string; drive: number; turn: number } & ParameterValues;
export type GaitRequest = { name: string; turn?: number } & ParameterValues;

export interface GaitAnswer {
  current: GaitState;
  catalogue: GaitEntry[];
}

export interface HeadControl {
  controller: string;
  neck_joints: number | null;
}

/** PUT /head: what is left out stays; a positive turn is to the left. */
export type HeadRequest = Partial<HeadControl> & { turn_by_deg?: number };

export interface HeadEntry {
  name: string;
  title: string;
  summary: string;
  /** Whether its reference line, and so the robot, can be turned. */
  steers: boolean;
  available: boolean;
  /** Why it is not available. */
  reason: string | null;
}

export interface HeadAnswer {
  current: HeadControl | null;
  controllers: HeadEntry[];
  neck_joints: { min: number; max: number; default: number };
  turn_by_deg: { min: number; max: number };
}

/** How far the ground is free, and the turn of a patrol: null where it can go no further. */
export interface ClearanceAnswer {
  directions_deg: number[];
  free_m: number[] | null;
  turn: -1 | 0 | 1 | null;
  reason: string | null;
}

/** How still the head is over the last `window_s`; the yaw is the deviation from the mean heading. */
export interface HeadMotion {
  yaw_deg: number | null;
  yaw_rms_deg: number | null;
  yaw_rate_deg_s: number | null;
  peak_yaw_rate_deg_s: number | null;
  sway_m: number | null;
  heading_deg: number | null;
  window_s: number | null;
}

export type Verdict = "initialising" | "good" | "degraded" | "blind" | "lost";

export interface Health {
  verdict: Verdict;
  reasons: string[];
  tracks: number;
  /** False after a new start whose map nothing ties to the old one. */
  map_connected: boolean;
}

export type Role = "viewer" | "operator";

/** The right to move the robot, as its holder has it. */
export interface Lease {
  key: string;
  id: number;
  holder: string;
  seconds: number;
}

export interface RobotState {
  source: { kind: "sim" | "recording"; name: string };
  t_s: number;
  moving: boolean;
  estop: { latched: boolean; reason: string | null };
  /** Who may move the robot; null while nobody has taken control. */
  control: { id: number | null; holder: string | null };
  gait: GaitState;
  /** What the operator should know of the gait, such as that it barely advances. */
  notice: string | null;
  /** Why the robot is held until somebody starts it again; null when it is not. */
  held_because: string | null;
  /** It was stopped because the camera saw nothing; the operator may back it up. */
  back_up_offered: boolean;
  /** Null without a robot. */
  head_control: HeadControl | null;
  robot: { model: string; joints: number };
  estimator: { mode: string };
  health: Health;
  realtime_factor: number | null;
  session: "running" | "starting" | "ended" | "failed";
  /** Another number, another session: nothing shown before belongs to it. */
  session_number: number;
  playback: Playback | null;
  message: string | null;
}

/** How a recording plays; seconds count from its first frame. */
export interface Playback {
  paused: boolean;
  speed: number;
  position_s: number;
  /** How far the estimator has come; what is ahead has to be computed first. */
  computed_s: number;
  duration_s: number;
  seeking: boolean;
  at_end: boolean;
  /** Counts the jumps. */
  seeks: number;
}

/** PUT /playback: what is left out stays as it is. */
export type PlaybackRequest = Partial<Pick<Playback, "paused" | "speed" | "position_s">> & { step?: number };

export interface Tick {
  t_s: number;
  realtime_factor: number | null;
  frame_rate_hz: number | null;
  q_target: number[];
  q_measured: number[];
  moving: boolean;
  drive: number;
  turn: number;
  head: HeadMotion;
  health: Health;
  /** Share of the commanded pace that the governor allows, and why not all; null where it is off. */
  governor: { pace: number; phase: "full" | "slowing" | "slow" | "returning"; reason: string | null } | null;
  error_m: number | null;
  distance_m: number | null;
  map_points: number;
  playback: Playback | null;
  /** Null where nothing is known of the body. */
  body: Body | null;
}

/** Where each link begins, tail to head, as x, y, z in turn, in the estimate's world, in m. */
export interface Body {
  p_m: number[];
  heading_deg: number;
  /** False before the first estimate: the joints are measured, the place is not. */
  estimated: boolean;
}

export interface TimelineEvent {
  t_s: number;
  level: "info" | "warning" | "error";
  text: string;
}

/** One tracked feature: x in px, y in px, 1 for an inlier, id. */
export type Track = [number, number, 0 | 1, number];

export interface Frame {
  t_s: number;
  seq: number;
  width: number;
  height: number;
  jpeg: Uint8Array<ArrayBuffer>;
}

/** What the estimator followed into a frame; it comes a little later than the frame. */
export interface Features {
  t_s: number;
  seq: number;
  tracks: Track[];
  /** How far the camera was rolled clockwise about its view; null when the estimator does not know. */
  roll_deg: number | null;
}

/** A camera frame that is on the screen; `shown_ms` counts as Date.now() does, but finer. */
export interface ShownPicture {
  t_s: number;
  seq: number;
  width: number;
  height: number;
  roll_deg: number | null;
  shown_ms: number;
}

export interface Recording {
  id: string;
  name: string;
  kind: string;
  frames: number | null;
  duration_s: number | null;
  /** Of the run whose own sensors these are; null for others' recordings. */
  gait: string | null;
  world: string | null;
  seed: number | null;
  when: string | null;
}

export type Overrides = Record<string, string | number | boolean>;

export interface RunRequest {
  config: string;
  overrides: Overrides;
  seed: number;
  duration_s: number;
}

export interface RunMetrics {
  ate_m?: { posyaw: number | null; se3: number | null } | null;
  tracked_fraction?: number | null;
  resets?: number | null;
  path_m?: number | null;
  speed_m_s?: number | null;
  realtime_factor?: number | null;
}

export interface Run {
  id: string;
  /** What it was: gait and seed, the configuration's name, the world, and when it was asked for (UTC, ISO 8601). */
  name: string;
  config: string | null;
  gait: string | null;
  world: string | null;
  seed: number | null;
  when: string | null;
  state: "queued" | "running" | "done" | "failed" | "cancelled" | "interrupted";
  progress: number;
  metrics: RunMetrics | null;
  artifacts: string[];
  error: string | null;
  request?: RunRequest;
}

// The names under which the page uses the server's models. They are generated from the API's OpenAPI schema when the
// page is built; what is declared here by hand belongs to the page alone.

import type { components } from "./generated/api";

type Models = components["schemas"];

export type GaitEntry = Models["GaitEntry"];
export type GaitParameter = Models["GaitParameter"];
export type GaitSamples = Models["GaitDrawing"];
export type ParameterKey = GaitParameter["key"];
export type ParameterValues = Partial<Record<ParameterKey, number | null>>;
export type GaitRequest = Models["GaitRequest"];
export type HeadAnswer = Models["HeadAnswer"];
export type HeadEntry = Models["HeadEntryAnswer"];
export type HeadRequest = Models["HeadRequest"];
export type HeadMotion = Models["HeadMotion"];
export type Health = Models["HealthState"];
export type Verdict = Models["Verdict"];
export type Role = Models["SessionAnswer"]["role"];
export type Lease = Models["LeaseAnswer"];
export type RobotState = Models["State"];
export type Playback = Models["Playback"];
export type PlaybackRequest = Models["PlaybackRequest"];
export type Body = Models["Body"];
export type Tick = Models["Tick"];
export type TimelineEvent = Models["TimelineEvent"];
export type Features = Models["Features"];
export type TelemetryMessage = Models["TelemetryMessage"];
export type TeleopInput = Models["TeleopInput"];
export type TeleopAnswer = Models["TeleopAnswer"];
export type Recording = Models["RecordingAnswer"];
export type Run = Models["RunAnswer"];
export type RunRequest = Models["RunRequest"];
/** What a deadman input asks for: drive and turn in [-1, 1]. */
export type Drive = Required<Pick<Models["DriveInput"], "drive" | "turn">>;
export type Overrides = NonNullable<Models["SimRequest"]["overrides"]>;
export type RunOverrides = NonNullable<RunRequest["overrides"]>;
export type Mode = NonNullable<Models["PlayRequest"]["mode"]>;

/** A camera frame: the header that comes with it on /telemetry, and its image. */
export type Frame = Models["ImageHeader"] & { jpeg: Uint8Array<ArrayBuffer> };

/** A camera image that is on the screen; `shown_ms` counts as Date.now() does, but finer. */
export type ShownImage = Models["ImageHeader"] & { roll_deg: number | null; shown_ms: number };

// The typed client of /api/v1: every refusal becomes one clear line.

import type { ClearanceAnswer, GaitAnswer, GaitRequest, HeadAnswer, HeadRequest, Lease, Overrides, Playback, PlaybackRequest, Recording, RobotState, Role, Run, RunRequest } from "./types";

const PREFIX = "/api/v1";
const TIMEOUT_MS = 10_000;
let leaseKey: string | null = null;

/** Send this lease with every request from now on. */
export function useLease(key: string | null): void {
  leaseKey = key;
}

/** A request the server refused, or that never reached it (status 0). */
export class ApiError extends Error {
  constructor(
    readonly status: number,
    detail: string,
  ) {
    super(detail);
  }
}

/** What a problem+json body says in one line, or the status where there is none. */
async function problemLine(response: Response): Promise<string> {
  try {
    const body = (await response.json()) as { detail?: unknown; title?: unknown };
    if (typeof body.detail === "string") return body.detail;
    if (typeof body.title === "string") return body.title;
  } catch {
    // Not JSON (a proxy's page, an empty body): the status line below says what is known.
  }
  return `The server answered ${response.status} ${response.statusText}`.trim();
}

async function request<T>(method: string, path: string, body?: unknown, timeoutMs = TIMEOUT_MS, keepalive = false): Promise<T> {
  let response: Response;
  const headers: Record<string, string> = {};
  const options: RequestInit = { method, headers, keepalive, credentials: "same-origin", signal: AbortSignal.timeout(timeoutMs) };
  if (leaseKey !== null) headers["Control-Lease"] = leaseKey;
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    headers["Content-Type"] = "application/json";
  }
  try {
    response = await fetch(PREFIX + path, options);
  } catch (error) {
    const late = error instanceof DOMException && error.name === "TimeoutError";
    throw new ApiError(0, late ? "The server did not answer in time" : "The server cannot be reached");
  }
  if (!response.ok) throw new ApiError(response.status, await problemLine(response));
  const text = await response.text();
  return (text === "" ? undefined : JSON.parse(text)) as T;
}

export const api = {
  state: (timeoutMs?: number) => request<RobotState>("GET", "/state", undefined, timeoutMs),
  session: () => request<{ role: Role }>("GET", "/session"),
  takeControl: (name: string, take_over: boolean) => request<Lease>("POST", "/control/lease", { name, take_over }),
  releaseControl: () => request<unknown>("DELETE", "/control/lease", undefined, TIMEOUT_MS, true),
  signIn: (token: string) => request<unknown>("POST", "/session", { token }),
  gait: () => request<GaitAnswer>("GET", "/gait"),
  setGait: (gait: GaitRequest) => request<unknown>("PUT", "/gait", gait),
  clearance: (turning: number) => request<ClearanceAnswer>("GET", `/map/clearance?turning=${turning}`),
  head: () => request<HeadAnswer>("GET", "/head"),
  setHead: (head: HeadRequest) => request<unknown>("PUT", "/head", head),
  start: () => request<unknown>("POST", "/gait/start"),
  backUp: () => request<unknown>("POST", "/gait/back-up"),
  stop: () => request<unknown>("POST", "/gait/stop"),
  // Short: a stop that does not get through must be tried again soon.
  estop: (reason: string) => request<unknown>("POST", "/estop", { reason }, 1500),
  resetEstop: () => request<unknown>("POST", "/estop/reset"),
  recordings: () => request<Recording[]>("GET", "/recordings"),
  // Without a mode the server takes the one that the recording's sensors allow.
  play: (id: string, mode: string | null) =>
    request<unknown>("POST", `/recordings/${encodeURIComponent(id)}/play`, mode === null ? {} : { mode }, 60_000),
  playback: (change: PlaybackRequest) => request<Playback>("PUT", "/playback", change),
  startSim: (overrides: Overrides) => request<unknown>("POST", "/sim/start", { overrides }, 60_000),
  runs: () => request<Run[]>("GET", "/runs"),
  submitRun: (run: RunRequest) => request<Run>("POST", "/runs", run),
  cancelRun: (id: string) => request<unknown>("DELETE", `/runs/${encodeURIComponent(id)}`),
  artifactUrl: (id: string, name: string) =>
    `${PREFIX}/runs/${encodeURIComponent(id)}/artifacts/${encodeURIComponent(name)}`,
};

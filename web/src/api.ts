// The typed client of /api/v1: whatever fails becomes one line that says what failed, where, and what to do.

import type { ClearanceAnswer, GaitAnswer, GaitRequest, HeadAnswer, HeadRequest, Lease, Overrides, Playback, PlaybackRequest, Recording, RobotState, Role, Run, RunRequest } from "./types";

const PREFIX = "/api/v1";
const TIMEOUT_MS = 10_000;
const LONG_MS = 60_000;
let leaseKey: string | null = null;

/** Send this lease with every request from now on. */
export function useLease(key: string | null): void {
  leaseKey = key;
}

/** A request the server refused, or that never reached it or was not answered (status 0). */
export class ApiError extends Error {
  constructor(
    readonly status: number,
    detail: string,
  ) {
    super(detail);
  }
}

interface Call {
  /** What is done, as the beginning of a sentence: "Starting the robot". */
  what: string;
  method: string;
  path: string;
  body?: unknown;
  timeoutMs?: number;
  keepalive?: boolean;
}

/** What a problem+json body says in one line; null where the answer is of another kind (a proxy's page, an empty body). */
function problemDetail(text: string): string | null {
  try {
    const body = JSON.parse(text) as { detail?: unknown; title?: unknown } | null;
    for (const words of [body?.detail, body?.title]) if (typeof words === "string" && words !== "") return words;
  } catch {
    // Not JSON: the caller says what the status tells.
  }
  return null;
}

/** The server's words for a status without a detail, and what the operator can do about it. */
function statusWords({ status, statusText }: Response): string {
  const answer = `the server answered ${status} ${statusText}`.trim();
  if (status === 429) return `${answer}: too many requests. Wait a moment, then try again`;
  if (status === 502 || status === 503 || status === 504) return `${answer}. It may be starting: try again in a few seconds`;
  return status >= 500 ? `${answer}. Its log says why` : answer;
}

function sentence(words: string): string {
  return /[.!?]$/.test(words) ? words : `${words}.`;
}

/** Why no answer came, where it was expected, and what to do. */
function unanswered({ what, method, path, timeoutMs = TIMEOUT_MS }: Call, late: boolean): ApiError {
  const where = `${method} ${PREFIX}${path} at ${location.host}`;
  if (late) {
    // Whether a command was carried out is not known then.
    const check = method === "GET" ? "Try again" : "Look whether it has happened before you try again";
    return new ApiError(0, `${what} failed: no answer to ${where} within ${timeoutMs / 1000} s. ${check}.`);
  }
  return new ApiError(0, `${what} failed: ${where} cannot be reached. Check that the server runs; the page reconnects by itself.`);
}

async function request<T>(call: Call): Promise<T> {
  const headers: Record<string, string> = {};
  const signal = AbortSignal.timeout(call.timeoutMs ?? TIMEOUT_MS);
  const options: RequestInit = { method: call.method, headers, keepalive: call.keepalive ?? false, credentials: "same-origin", signal };
  if (leaseKey !== null) headers["Control-Lease"] = leaseKey;
  if (call.body !== undefined) {
    options.body = JSON.stringify(call.body);
    headers["Content-Type"] = "application/json";
  }
  let response: Response;
  let text: string;
  try {
    response = await fetch(PREFIX + call.path, options);
    // The time may also run out between the answer's head and its body.
    text = await response.text();
  } catch {
    throw unanswered(call, signal.aborted);
  }
  if (!response.ok) throw new ApiError(response.status, sentence(`${call.what} failed: ${problemDetail(text) ?? statusWords(response)}`));
  try {
    return (text === "" ? undefined : JSON.parse(text)) as T;
  } catch {
    const where = `${call.method} ${PREFIX}${call.path} at ${location.host}`;
    throw new ApiError(response.status, `${call.what} failed: the answer to ${where} is not JSON. Check what stands between this page and the server.`);
  }
}

const get = <T>(what: string, path: string, timeoutMs = TIMEOUT_MS) => request<T>({ what, method: "GET", path, timeoutMs });
const post = <T>(what: string, path: string, body?: unknown, timeoutMs = TIMEOUT_MS) =>
  request<T>({ what, method: "POST", path, body, timeoutMs });
const put = <T>(what: string, path: string, body: unknown) => request<T>({ what, method: "PUT", path, body });

export const api = {
  state: (timeoutMs?: number) => get<RobotState>("Reading the robot's state", "/state", timeoutMs),
  session: () => get<{ role: Role }>("Reading what you may do", "/session"),
  takeControl: (name: string, take_over: boolean) =>
    post<Lease>(take_over ? "Taking over control" : "Taking control", "/control/lease", { name, take_over }),
  releaseControl: () =>
    request<unknown>({ what: "Giving control back", method: "DELETE", path: "/control/lease", keepalive: true }),
  signIn: (token: string) => post<unknown>("Signing in", "/session", { token }),
  gait: () => get<GaitAnswer>("Reading the gaits", "/gait"),
  setGait: (gait: GaitRequest) => put<unknown>("Setting the gait", "/gait", gait),
  clearance: (turning: number) => get<ClearanceAnswer>("Reading how far the ground is free", `/map/clearance?turning=${turning}`),
  head: () => get<HeadAnswer>("Reading the head controllers", "/head"),
  setHead: (head: HeadRequest) => put<unknown>("Setting the head control", "/head", head),
  start: () => post<unknown>("Starting the robot", "/gait/start"),
  backUp: () => post<unknown>("Backing up", "/gait/back-up"),
  stop: () => post<unknown>("Stopping the robot", "/gait/stop"),
  // Short: a stop that does not get through must be tried again soon.
  estop: (reason: string) => post<{ confirmed?: boolean }>("The emergency stop", "/estop", { reason }, 1500),
  resetEstop: () => post<unknown>("Resetting the emergency stop", "/estop/reset"),
  recordings: () => get<Recording[]>("Reading the list of recordings", "/recordings"),
  // Without a mode the server takes the one that the recording's sensors allow.
  play: (id: string, mode: string | null) =>
    post<unknown>("Playing the recording", `/recordings/${encodeURIComponent(id)}/play`, mode === null ? {} : { mode }, LONG_MS),
  playback: (change: PlaybackRequest) => put<Playback>("Changing the playback", "/playback", change),
  startSim: (overrides: Overrides) => post<unknown>("Starting the simulator", "/sim/start", { overrides }, LONG_MS),
  runs: () => get<Run[]>("Reading the list of runs", "/runs"),
  submitRun: (run: RunRequest) => post<Run>("Submitting the run", "/runs", run),
  cancelRun: (id: string) =>
    request<unknown>({ what: "Cancelling the run", method: "DELETE", path: `/runs/${encodeURIComponent(id)}` }),
  artifactUrl: (id: string, name: string) =>
    `${PREFIX}/runs/${encodeURIComponent(id)}/artifacts/${encodeURIComponent(name)}`,
};

// The typed client of /api/v1: whatever fails becomes one line that says what failed, where, and what to do.

import type { paths } from "../generated/api";
import type { GaitRequest, HeadRequest, Mode, Overrides, ParameterValues, PlaybackRequest, RunRequest } from "../types";

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

type Method = "get" | "post" | "put" | "delete";
type Json<Content> = Content extends { content: { "application/json": infer T } } ? T : never;
/** What an operation of the schema answers, and the body that it takes. */
type Answer<Operation> = Operation extends { responses: infer R } ? (R extends { 200: infer Ok } ? Json<Ok> : R extends { 202: infer Ok } ? Json<Ok> : undefined) : never;
type Body<Operation> = Operation extends { requestBody?: infer B } ? Json<NonNullable<B>> : never;

type Query = Record<string, string | number | null | undefined>;

interface Options<Body> {
  body?: Body;
  /** What stands in the path's braces. */
  path?: Record<string, string>;
  /** What is null or undefined is left out. */
  query?: Query;
  timeoutMs?: number;
  keepalive?: boolean;
}

interface Call {
  /** What is done, as the beginning of a sentence: "Starting the robot". */
  what: string;
  method: string;
  /** With the API's prefix and the query. */
  path: string;
  timeoutMs: number;
}

/** What a problem+json body says in one line; null where the answer is of another kind (a proxy's page, an empty body). */
function problemDetail(text: string): string | null {
  try {
    const body = JSON.parse(text) as { detail?: unknown; title?: unknown } | null;
    for (const words of [body?.detail, body?.title]) if (typeof words === "string" && words !== "") return words;
  } catch {
    // Not JSON: the caller says what the status means.
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
function unanswered({ what, method, path, timeoutMs }: Call, late: boolean): ApiError {
  const where = `${method} ${path} at ${location.host}`;
  if (late) {
    // Whether a command was carried out is not known then.
    const check = method === "GET" ? "Try again" : "Look whether it has happened before you try again";
    return new ApiError(0, `${what} failed: no answer to ${where} within ${timeoutMs / 1000} s. ${check}.`);
  }
  return new ApiError(0, `${what} failed: ${where} cannot be reached. Check that the server runs; the page reconnects by itself.`);
}

/** The address of an operation: its path in the schema with the braces filled in, and the query. */
function address(template: string, path: Record<string, string>, query: Query): string {
  const filled = template.replace(/\{(\w+)\}/g, (_, name: string) => encodeURIComponent(path[name] ?? ""));
  const given = Object.entries(query).flatMap(([key, value]) => (value == null ? [] : `${key}=${encodeURIComponent(value)}`));
  return given.length === 0 ? filled : `${filled}?${given.join("&")}`;
}

async function request<P extends keyof paths, M extends Method & keyof paths[P]>(
  what: string,
  method: M,
  template: P,
  { body, path = {}, query = {}, timeoutMs = TIMEOUT_MS, keepalive = false }: Options<Body<paths[P][M]>> = {},
): Promise<Answer<paths[P][M]>> {
  const call: Call = { what, method: method.toUpperCase(), path: address(template, path, query), timeoutMs };
  const headers: Record<string, string> = {};
  const signal = AbortSignal.timeout(timeoutMs);
  const options: RequestInit = { method: call.method, headers, keepalive, credentials: "same-origin", signal };
  if (leaseKey !== null) headers["Control-Lease"] = leaseKey;
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    headers["Content-Type"] = "application/json";
  }
  let response: Response;
  let text: string;
  try {
    response = await fetch(call.path, options);
    // The time may also run out between the answer's head and its body.
    text = await response.text();
  } catch {
    throw unanswered(call, signal.aborted);
  }
  if (!response.ok) throw new ApiError(response.status, sentence(`${what} failed: ${problemDetail(text) ?? statusWords(response)}`));
  try {
    return (text === "" ? undefined : JSON.parse(text)) as Answer<paths[P][M]>;
  } catch {
    const where = `${call.method} ${call.path} at ${location.host}`;
    throw new ApiError(response.status, `${what} failed: the answer to ${where} is not JSON. Check what stands between this page and the server.`);
  }
}

export const api = {
  state: (timeoutMs: number) => request("Reading the robot's state", "get", "/api/v1/state", { timeoutMs }),
  session: () => request("Reading what you may do", "get", "/api/v1/session"),
  takeControl: (name: string, take_over: boolean) =>
    request(take_over ? "Taking over control" : "Taking control", "post", "/api/v1/control/lease", { body: { name, take_over } }),
  releaseControl: () => request("Giving control back", "delete", "/api/v1/control/lease", { keepalive: true }),
  signIn: (token: string) => request("Signing in", "post", "/api/v1/session", { body: { token } }),
  gait: () => request("Reading the gaits", "get", "/api/v1/gait"),
  previewGait: (name: GaitRequest["name"], values: ParameterValues) =>
    request("Reading what the gait looks like", "get", "/api/v1/gait/preview", { query: { name, ...values } }),
  setGait: (body: GaitRequest) => request("Setting the gait", "put", "/api/v1/gait", { body }),
  clearance: (turning: number) => request("Reading how far the ground is free", "get", "/api/v1/map/clearance", { query: { turning } }),
  head: () => request("Reading the head controllers", "get", "/api/v1/head"),
  setHead: (body: HeadRequest) => request("Setting the head control", "put", "/api/v1/head", { body }),
  start: () => request("Starting the robot", "post", "/api/v1/gait/start"),
  backUp: () => request("Backing up", "post", "/api/v1/gait/back-up"),
  stop: () => request("Stopping the robot", "post", "/api/v1/gait/stop"),
  // Short: a stop that does not get through must be tried again soon.
  estop: (reason: string) => request("The emergency stop", "post", "/api/v1/estop", { body: { reason }, timeoutMs: 1500 }),
  resetEstop: () => request("Resetting the emergency stop", "post", "/api/v1/estop/reset"),
  recordings: () => request("Reading the list of recordings", "get", "/api/v1/recordings"),
  // Without a mode the server takes the one that the recording's sensors allow.
  play: (recording_id: string, mode: Mode | null) =>
    request("Playing the recording", "post", "/api/v1/recordings/{recording_id}/play", { path: { recording_id }, body: { mode }, timeoutMs: LONG_MS }),
  playback: (body: PlaybackRequest) => request("Changing the playback", "put", "/api/v1/playback", { body }),
  startSim: (overrides: Overrides) =>
    request("Starting the simulator", "post", "/api/v1/sim/start", { body: { overrides }, timeoutMs: LONG_MS }),
  runs: () => request("Reading the list of runs", "get", "/api/v1/runs"),
  submitRun: (body: RunRequest) => request("Submitting the run", "post", "/api/v1/runs", { body }),
  cancelRun: (run_id: string) => request("Cancelling the run", "delete", "/api/v1/runs/{run_id}", { path: { run_id } }),
  artifactUrl: (run_id: string, name: string) => address("/api/v1/runs/{run_id}/artifacts/{name}" satisfies keyof paths, { run_id, name }, {}),
};

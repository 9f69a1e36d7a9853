// Runs beside the page, in a thread of its own: the telemetry socket and the camera's image. Where a processor draws
// the 3D view, the page is busy for a fifth of a second at a time, and the operator's image does not wait for that.

import { Painter } from "../drawing/painter";
import { parseFrame, type FromWorker, type ToWorker } from "./telemetry-link";
import type { TelemetryMessage } from "../types";

const PING_EVERY_MS = 1000;

// The page's own types do not know what a worker's global object has.
const page = self as unknown as {
  postMessage(message: FromWorker): void;
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
};
let socket: WebSocket | null = null;
let painter: Painter | null = null;

/** Time that the page can compare with its own. */
const epochMs = () => performance.timeOrigin + performance.now();

function connect(url: string): void {
  socket?.close();
  const opened = new WebSocket(url);
  opened.binaryType = "arraybuffer";
  socket = opened;
  opened.onopen = () => page.postMessage({ kind: "open" });
  opened.onmessage = (event: MessageEvent<string | ArrayBuffer>) => receive(event.data);
  opened.onclose = ({ reason }) => {
    if (socket !== opened) return;
    socket = null;
    page.postMessage({ kind: "closed", reason });
  };
}

function receive(data: string | ArrayBuffer): void {
  if (typeof data !== "string") {
    const frame = parseFrame(data);
    if (frame) painter?.show(frame);
    return;
  }
  const message = JSON.parse(data) as TelemetryMessage;
  if (message.type === "pong") page.postMessage({ kind: "round-trip", ms: performance.now() - message.t_ms });
  else if (message.type === "features") painter?.follow(message);
  else page.postMessage({ kind: "message", message });
}

function ping(): void {
  if (socket?.readyState === WebSocket.OPEN) {
    socket.send(JSON.stringify({ type: "ping", t_ms: Math.round(performance.now() * 10) / 10 }));
  } else page.postMessage({ kind: "round-trip", ms: null });
}

function draw(image: OffscreenCanvas, overlay: OffscreenCanvas): void {
  painter = new Painter(image, overlay, ({ t_s, seq, width, height }, roll_deg) =>
    page.postMessage({ kind: "image", image: { t_s, seq, width, height, roll_deg, shown_ms: epochMs() } }),
  );
}

page.onmessage = ({ data }) => {
  if (data.kind === "connect") connect(data.url);
  else if (data.kind === "draw") draw(data.image, data.overlay);
  else if (data.kind === "mark") painter?.mark(data.shown, data.colours);
  else if (data.kind === "clear") painter?.clear();
  else painter?.setLevel(data.level);
};
setInterval(ping, PING_EVERY_MS);

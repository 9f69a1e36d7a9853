// The telemetry websocket: messages in, reconnects with back-off, and says so when the server falls silent.

import { ApiError, api } from "./api";
import type { App } from "./app";
import type { Frame, RobotState, Tick, TimelineEvent } from "./types";

const FIRST_DELAY_MS = 400;
const LAST_DELAY_MS = 6000;
const SILENT_AFTER_MS = 2000;
const FRAME_KIND = 1;
const PING_EVERY_MS = 1000;

type Message = ({ type: "state" } & RobotState) | ({ type: "tick" } & Tick) | ({ type: "event" } & TimelineEvent)
  | { type: "pong"; t_ms: number };

/** One byte kind, a little-endian uint32 length, that much JSON, then the JPEG. */
export function parseFrame(buffer: ArrayBuffer): Frame | null {
  const view = new DataView(buffer);
  if (buffer.byteLength < 5 || view.getUint8(0) !== FRAME_KIND) return null;
  const length = view.getUint32(1, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 5, length))) as Omit<Frame, "jpeg">;
  return { ...header, jpeg: new Blob([new Uint8Array(buffer, 5 + length)], { type: "image/jpeg" }) };
}

export class Telemetry {
  private socket: WebSocket | null = null;
  private delayMs = FIRST_DELAY_MS;
  private retryTimer = 0;
  private asking = false;

  constructor(private readonly app: App) {}

  start(): void {
    this.connect();
    window.setInterval(() => void this.checkSilence(), 500);
    window.setInterval(() => this.ping(), PING_EVERY_MS);
  }

  /** Connect at once, as after signing in. */
  reconnect(): void {
    window.clearTimeout(this.retryTimer);
    this.delayMs = FIRST_DELAY_MS;
    this.socket?.close();
    this.connect();
  }

  private connect(): void {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/api/v1/telemetry`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => this.app.opened.emit();
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => this.receive(event.data);
    socket.onclose = () => {
      if (this.socket === socket) void this.dropped();
    };
  }

  private ping(): void {
    if (this.socket?.readyState === WebSocket.OPEN) {
      this.socket.send(JSON.stringify({ type: "ping", t_ms: Math.round(performance.now() * 10) / 10 }));
    } else this.app.roundTripMs.set(null);
  }

  private receive(data: string | ArrayBuffer): void {
    this.heard();
    if (typeof data !== "string") {
      const frame = parseFrame(data);
      if (frame) this.app.frame.emit(frame);
      return;
    }
    const message = JSON.parse(data) as Message;
    if (message.type === "tick") this.app.tick.emit(message);
    else if (message.type === "event") this.app.timeline.emit(message);
    else if (message.type === "state") this.app.state.set(message);
    else if (message.type === "pong") this.app.roundTripMs.set(performance.now() - message.t_ms);
  }

  private heard(): void {
    this.app.lastMessageMs = performance.now();
    this.delayMs = FIRST_DELAY_MS;
    if (this.app.link.get().phase !== "live") this.app.link.set({ phase: "live", retryAtMs: null });
  }

  /** A closed socket does not say why: ask over HTTP whether it is the sign-in or the link. */
  private async dropped(): Promise<void> {
    this.socket = null;
    const delay = this.delayMs * (0.8 + 0.4 * Math.random());
    this.delayMs = Math.min(this.delayMs * 1.7, LAST_DELAY_MS);
    this.app.link.set({ phase: "lost", retryAtMs: performance.now() + delay });
    try {
      await api.state(1500);
    } catch (error) {
      if (error instanceof ApiError && error.status === 401) {
        this.app.link.set({ phase: "signed-out", retryAtMs: null });
        return;
      }
    }
    this.retryTimer = window.setTimeout(() => this.connect(), delay);
  }

  /** An open socket may be quiet because nothing happens (a recording has ended) or because the other end is gone. */
  private async checkSilence(): Promise<void> {
    const last = this.app.lastMessageMs;
    if (this.socket?.readyState !== WebSocket.OPEN || last === null || this.asking) return;
    if (performance.now() - last < SILENT_AFTER_MS) return;
    this.asking = true;
    try {
      this.app.state.set(await api.state(SILENT_AFTER_MS));
      this.heard();
    } catch {
      this.app.link.set({ phase: "silent", retryAtMs: null });
    } finally {
      this.asking = false;
    }
  }
}

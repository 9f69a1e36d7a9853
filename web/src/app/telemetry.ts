// The page's end of the telemetry: reconnects with back-off, and says so when the server falls silent.

import { ApiError, api } from "../link/api";
import type { App } from "./app";
import type { Colours } from "../drawing/painter";
import type { FromWorker, Message, ToWorker } from "../link/telemetry-link";

const FIRST_DELAY_MS = 400;
const LAST_DELAY_MS = 6000;
const SILENT_AFTER_MS = 2000;

export class Telemetry {
  private readonly worker = new Worker(new URL("../link/telemetry-worker.ts", import.meta.url), { type: "module" });
  private open = false;
  private delayMs = FIRST_DELAY_MS;
  private retryTimer = 0;
  private asking = false;

  constructor(private readonly app: App) {
    this.worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.onMessage(data);
    this.worker.onerror = (event) => {
      const error = new Error(`the telemetry's worker: ${event.message || "it could not be loaded"}`);
      app.report(error);
    };
  }

  start(): void {
    this.connect();
    window.setInterval(() => void this.checkSilence(), 500);
  }

  /** Connect at once, as after signing in. */
  reconnect(): void {
    window.clearTimeout(this.retryTimer);
    this.delayMs = FIRST_DELAY_MS;
    this.connect();
  }

  /** Have the camera's image and its features drawn on these canvases, which nobody else may draw on then. */
  drawOn(image: HTMLCanvasElement, overlay: HTMLCanvasElement): void {
    const canvases = { image: image.transferControlToOffscreen(), overlay: overlay.transferControlToOffscreen() };
    this.post({ kind: "draw", ...canvases }, Object.values(canvases));
  }

  /** Say whether the features are drawn, and in what colours. */
  mark(shown: boolean, colours: Colours): void {
    this.post({ kind: "mark", shown, colours });
  }

  /** Say whether images are turned upright: they then wait for the estimator to say how far. */
  setLevel(level: boolean): void {
    this.post({ kind: "level", level });
  }

  /** Wipe the camera's image: it belongs to a session that is over. */
  clear(): void {
    this.post({ kind: "clear" });
  }

  private post(message: ToWorker, transfer: Transferable[] = []): void {
    this.worker.postMessage(message, transfer);
  }

  private connect(): void {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.post({ kind: "connect", url: `${scheme}://${location.host}/api/v1/telemetry` });
  }

  private onMessage(said: FromWorker): void {
    if (said.kind === "open") {
      this.open = true;
      this.app.opened.emit();
    } else if (said.kind === "closed") void this.dropped(said.reason);
    else if (said.kind === "round-trip") this.app.roundTripMs.set(said.ms);
    else if (said.kind === "image") {
      this.noteAlive();
      this.app.image.emit(said.image);
    } else this.receive(said.message);
  }

  private receive(message: Message): void {
    this.noteAlive();
    if (message.type === "tick") this.app.tick.emit(message);
    else if (message.type === "event") this.app.timeline.emit(message);
    else this.app.state.set(message);
  }

  private noteAlive(): void {
    this.app.lastMessageMs = performance.now();
    this.delayMs = FIRST_DELAY_MS;
    if (this.app.link.get().phase !== "live") this.app.link.set({ phase: "live", retryAtMs: null });
  }

  /** A closed socket does not say why: ask over HTTP whether it is the sign-in or the link. */
  private async dropped(reason: string): Promise<void> {
    this.open = false;
    const delay = this.delayMs * (0.8 + 0.4 * Math.random());
    this.delayMs = Math.min(this.delayMs * 1.7, LAST_DELAY_MS);
    this.app.link.set({ phase: "lost", retryAtMs: performance.now() + delay, reason });
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
    if (!this.open || last === null || this.asking) return;
    if (performance.now() - last < SILENT_AFTER_MS) return;
    this.asking = true;
    try {
      this.app.state.set(await api.state(SILENT_AFTER_MS));
      this.noteAlive();
    } catch {
      this.app.link.set({ phase: "silent", retryAtMs: null });
    } finally {
      this.asking = false;
    }
  }
}

// What the panels share: the last state, the link, and the streams of the telemetry.

import { ApiError, api } from "./api";
import { Cell, Channel } from "./store";
import type { Frame, GaitEntry, RobotState, Run, Tick, TimelineEvent } from "./types";

export type LinkPhase = "connecting" | "live" | "silent" | "lost" | "signed-out";

export interface Link {
  phase: LinkPhase;
  /** performance.now() of the next attempt, when one is waiting. */
  retryAtMs: number | null;
}

export interface Notice {
  level: "info" | "error";
  text: string;
}

export class App {
  readonly link = new Cell<Link>({ phase: "connecting", retryAtMs: null });
  readonly state = new Cell<RobotState | null>(null);
  readonly catalogue = new Cell<GaitEntry[]>([]);
  readonly runs = new Cell<Run[]>([]);
  readonly tick = new Channel<Tick>();
  readonly frame = new Channel<Frame>();
  readonly timeline = new Channel<TimelineEvent>();
  readonly notice = new Channel<Notice | null>();
  readonly theme = new Channel<void>();
  /** A telemetry socket has opened: what it sends next repeats what is known. */
  readonly opened = new Channel<void>();
  /** performance.now() of the last message of any kind. */
  lastMessageMs: number | null = null;

  /** Do what the operator asked; a refusal becomes one line on the page. */
  async attempt<T>(action: () => Promise<T>): Promise<T | null> {
    try {
      const answer = await action();
      this.notice.emit(null);
      return answer;
    } catch (error) {
      this.report(error);
      return null;
    }
  }

  report(error: unknown): void {
    if (error instanceof ApiError && error.status === 401) this.link.set({ phase: "signed-out", retryAtMs: null });
    else this.notice.emit({ level: "error", text: error instanceof Error ? error.message : String(error) });
  }

  async loadCatalogue(): Promise<void> {
    const answer = await this.attempt(() => api.gait());
    if (answer) this.catalogue.set(answer.catalogue);
  }

  /** Whether commands (other than the emergency stop) can be given now. */
  get commandable(): boolean {
    const state = this.state.get();
    return this.link.get().phase === "live" && state?.session === "running" && state.source.kind === "sim";
  }
}

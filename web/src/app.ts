// What the panels share: the last state, the link, and the streams of the telemetry.

import { ApiError, api } from "./api";
import { LeaseKeeper } from "./lease";
import { Redraw } from "./redraw";
import { Cell, Channel } from "./store";
import type { GaitEntry, RobotState, Role, Run, ShownPicture, Tick, TimelineEvent } from "./types";

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
  readonly role = new Cell<Role>("viewer");
  readonly lease = new LeaseKeeper(this);
  /** Of the telemetry socket, and from drive input to the session's word that it obeyed; null when not known. */
  readonly roundTripMs = new Cell<number | null>(null);
  readonly commandMs = new Cell<number | null>(null);
  readonly runs = new Cell<Run[]>([]);
  readonly tick = new Channel<Tick>();
  readonly picture = new Channel<ShownPicture>();
  readonly timeline = new Channel<TimelineEvent>();
  readonly notice = new Channel<Notice | null>();
  readonly theme = new Channel<void>();
  readonly redraw = new Redraw();
  /** A telemetry socket has opened: what it sends next repeats what is known. */
  readonly opened = new Channel<void>();
  /** Another session: what panels show and keep of the one before is void. */
  readonly cleared = new Channel<void>();
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

  /** Do what needs control: taken first where it is free, refused where another has it. */
  async command<T>(action: () => Promise<T>): Promise<T | null> {
    return this.attempt(async () => {
      await this.lease.ensure();
      return action();
    });
  }

  report(error: unknown): void {
    if (error instanceof ApiError && error.status === 401) this.link.set({ phase: "signed-out", retryAtMs: null });
    else this.notice.emit({ level: "error", text: error instanceof Error ? error.message : String(error) });
  }

  async loadRole(): Promise<void> {
    const answer = await this.attempt(() => api.session());
    if (answer) this.role.set(answer.role);
  }

  async loadCatalogue(): Promise<void> {
    const answer = await this.attempt(() => api.gait());
    if (answer) this.catalogue.set(answer.catalogue);
  }

  /** Whether commands (other than the emergency stop) can be given now. */
  get commandable(): boolean {
    const state = this.state.get();
    const robot = state?.session === "running" && state.source.kind === "sim";
    return this.link.get().phase === "live" && robot && this.mayCommand;
  }

  /** Whether this page has control or may have it for the asking. */
  get mayCommand(): boolean {
    return this.role.get() === "operator" && (this.lease.mine || this.state.get()?.control.id == null);
  }
}

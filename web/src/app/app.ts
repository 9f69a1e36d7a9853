// What the panels share: the last state, the link, and the streams of the telemetry.

import { ApiError, api } from "../link/api";
import { errorLine } from "../link/failure";
import { LeaseKeeper } from "./lease";
import { Redraw } from "../basics/redraw";
import { Cell, Channel } from "../basics/store";
import type { GaitEntry, RobotState, Role, Run, ShownImage, Tick, TimelineEvent } from "../types";

const RETRY_MS = 1000;
const LAST_RETRY_MS = 15_000;

export type LinkPhase = "connecting" | "live" | "silent" | "lost" | "signed-out";

export interface Link {
  phase: LinkPhase;
  /** performance.now() of the next attempt, when one is waiting. */
  retryAtMs: number | null;
  /** What the server said when it closed the link, if it said anything. */
  reason?: string;
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
  readonly lease = new LeaseKeeper(this.state, this.role);
  /** Of the telemetry socket, and from drive input to the session's answer that it was obeyed; null when not known. */
  readonly roundTripMs = new Cell<number | null>(null);
  readonly commandMs = new Cell<number | null>(null);
  readonly runs = new Cell<Run[]>([]);
  /** Why the list of runs could not be read; null when it could. */
  readonly runsProblem = new Cell<string | null>(null);
  readonly tick = new Channel<Tick>();
  readonly image = new Channel<ShownImage>();
  readonly timeline = new Channel<TimelineEvent>();
  readonly notice = new Channel<Notice | null>();
  readonly theme = new Channel<void>();
  readonly redraw = new Redraw();
  /** A telemetry socket has opened: what it sends next repeats what is known. */
  readonly opened = new Channel<void>();
  /** Another session: what panels show and keep of the one before is void. */
  readonly cleared = new Channel<void>();
  /** Role and gaits have been read anew: what else depends on server and sign-in should be as well. */
  readonly reloaded = new Channel<void>();
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
    else this.notice.emit({ level: "error", text: errorLine(error) });
    // This browser may have been signed in as somebody else since.
    if (error instanceof ApiError && error.status === 403) void this.loadRole();
  }

  /** Read what may be another after a restart or another sign-in; what is the same stays untouched, with what is being typed. */
  async reload(): Promise<void> {
    await Promise.all([this.loadRole(), this.loadCatalogue()]);
    this.reloaded.emit();
  }

  async loadRole(): Promise<void> {
    const answer = await this.background(() => api.session());
    if (answer && answer.role !== this.role.get()) this.role.set(answer.role);
    if (answer?.role === "viewer") this.lease.lost();
  }

  async loadCatalogue(): Promise<void> {
    const answer = await this.background(() => api.gait());
    if (answer && JSON.stringify(answer.catalogue) !== JSON.stringify(this.catalogue.get())) this.catalogue.set(answer.catalogue);
  }

  /** Ask for what the page itself needs; again as long as the link lives and nothing has come. */
  private async background<T>(ask: () => Promise<T>): Promise<T | null> {
    for (let delayMs = RETRY_MS; ; delayMs = Math.min(2 * delayMs, LAST_RETRY_MS)) {
      try {
        return await ask();
      } catch (error) {
        if (error instanceof ApiError && error.status === 401) this.report(error);
        if (this.link.get().phase !== "live") return null;
        // It is reported once, to whoever can do something about it; the page goes on asking.
        if (delayMs === RETRY_MS) this.report(error);
        await new Promise((resolve) => setTimeout(resolve, delayMs));
      }
    }
  }

  /** Whether commands (other than the emergency stop) can be given now. */
  get commandable(): boolean {
    const state = this.state.get();
    const robot = state?.session === "running" && state.source.kind === "sim";
    return this.link.get().phase === "live" && robot && this.mayCommand;
  }

  /** Whether this page has control or may have it for the asking. */
  get mayCommand(): boolean {
    return this.role.get() === "operator" && (this.lease.mine || this.lease.pending || this.state.get()?.control.id == null);
  }
}

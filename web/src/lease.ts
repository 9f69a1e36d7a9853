// Control of the robot: this page's lease, kept by the teleop socket that goes with it.

import { ApiError, api, useLease } from "./api";
import type { App } from "./app";
import { OperatorName } from "./operator-name";
import { Cell } from "./store";
import type { Lease, RobotState } from "./types";

/** Of control that is taken over, the new holder is known so soon after the drive's socket has closed. */
const NEW_HOLDER_MS = 2000;

/** How this page lost control without giving it back. */
export interface Loss {
  /** Who has it instead; null when it lapsed. */
  by: string | null;
  at: Date;
}

export class LeaseKeeper {
  /** The lease in hand; null without. */
  readonly current = new Cell<Lease | null>(null);
  /** How control was lost last; null once this page has it again, or has been told enough. */
  readonly loss = new Cell<Loss | null>(null);
  readonly name = new OperatorName();
  private asking: Promise<void> | null = null;

  constructor(private readonly app: App) {
    app.state.watch((state) => this.follow(state));
    // A page that goes gives control back, and the robot stops.
    window.addEventListener("pagehide", () => {
      if (this.mine) void api.releaseControl().catch(() => undefined);
      this.hold(null);
    });
  }

  get mine(): boolean {
    return this.current.get() !== null;
  }

  /** Whether it is being asked for: the state may name this page's new lease before the answer is here. */
  get pending(): boolean {
    return this.asking !== null;
  }

  /** Have control, or throw the reason why not. */
  async ensure(): Promise<void> {
    if (this.mine) return;
    this.asking ??= this.take(false).finally(() => (this.asking = null));
    await this.asking;
  }

  async take(over: boolean): Promise<void> {
    if (this.app.role.get() !== "operator") throw new ApiError(403, "You are signed in to watch: you may press the emergency stop, nothing else.");
    this.hold(await api.takeControl(this.name.text, over));
    this.loss.set(null);
  }

  async release(): Promise<void> {
    await api.releaseControl();
    this.hold(null);
  }

  /** The server says that it is gone. */
  lost(): void {
    const lease = this.current.get();
    if (lease === null) return;
    const { id = null, holder = null } = this.app.state.get()?.control ?? {};
    this.hold(null);
    this.loss.set({ by: id !== null && id > lease.id ? holder : null, at: new Date() });
  }

  /** What the server says of control, which may come before or after the closed drive socket. */
  private follow(state: RobotState | null): void {
    const lease = this.current.get();
    const { id = null, holder = null } = state?.control ?? {};
    if (lease !== null && id !== null && id > lease.id) this.lost();
    const loss = this.loss.get();
    if (lease !== null || holder === null || loss === null || loss.by !== null) return;
    if (Date.now() - loss.at.getTime() < NEW_HOLDER_MS) this.loss.set({ ...loss, by: holder });
  }

  private hold(lease: Lease | null): void {
    useLease(lease?.key ?? null);
    this.current.set(lease);
  }
}

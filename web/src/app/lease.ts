// Control of the robot: this page's lease, kept by the teleop socket that goes with it.

import { ApiError, api, useLease } from "../link/api";
import { OperatorName } from "../basics/operator-name";
import { Cell } from "../basics/store";
import type { Lease, RobotState, Role } from "../types";

/** After a takeover the state names the new holder within this time of the drive socket's closing. */
const NEW_HOLDER_MS = 2000;

/** How this page lost control without giving it back. */
export interface Loss {
  /** Who has it instead; null when it lapsed. */
  by: string | null;
  at: Date;
}

export class LeaseKeeper {
  /** This page's lease; null without control. */
  readonly current = new Cell<Lease | null>(null);
  /** How control was lost last; null once this page has it again, or the banner was closed. */
  readonly loss = new Cell<Loss | null>(null);
  readonly name = new OperatorName();
  private asking: Promise<void> | null = null;

  constructor(
    private readonly state: Cell<RobotState | null>,
    private readonly role: Cell<Role>,
  ) {
    state.watch((state) => this.follow(state));
    // A page that is left gives control back, and the robot stops.
    window.addEventListener("pagehide", () => {
      if (this.mine) void api.releaseControl().catch(() => undefined);
      this.hold(null);
    });
  }

  get mine(): boolean {
    return this.current.get() !== null;
  }

  /** Whether it is being requested: the state may name this page's new lease before the answer arrives. */
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
    if (this.role.get() !== "operator") throw new ApiError(403, "You are signed in to watch: you may press the emergency stop, nothing else.");
    this.hold(await api.takeControl(this.name.text, over));
    this.loss.set(null);
  }

  async release(): Promise<void> {
    await api.releaseControl();
    this.hold(null);
  }

  /** The server has ended the lease. */
  lost(): void {
    const lease = this.current.get();
    if (lease === null) return;
    const { id = null, holder = null } = this.state.get()?.control ?? {};
    this.hold(null);
    this.loss.set({ by: id !== null && id > lease.id ? holder : null, at: new Date() });
  }

  /** Follow the state's holder of control; the state may come before or after the closing of the drive socket. */
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

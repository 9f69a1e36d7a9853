// Control of the robot: this page's lease, kept by the teleop socket that goes with it.

import { ApiError, api, useLease } from "./api";
import type { App } from "./app";
import { Cell } from "./store";
import type { Lease } from "./types";

/** How others see this page. */
function ownName(): string {
  const agent = navigator.userAgent;
  const browser = ["Firefox", "Edg", "Chrome", "Safari"].find((name) => agent.includes(name)) ?? "Browser";
  const system = ["Android", "iPhone", "iPad", "Windows", "Mac", "Linux"].find((name) => agent.includes(name)) ?? "";
  const mark = crypto.getRandomValues(new Uint8Array(1))[0] ?? 0;
  return `${browser === "Edg" ? "Edge" : browser} ${system} ${mark.toString(16).padStart(2, "0")}`.replace(/ +/g, " ");
}

export class LeaseKeeper {
  /** The lease in hand; null without. */
  readonly current = new Cell<Lease | null>(null);
  private readonly name = ownName();
  private asking: Promise<void> | null = null;

  constructor(private readonly app: App) {
    // A page that goes gives control back, and the robot stops.
    window.addEventListener("pagehide", () => {
      if (this.mine) void api.releaseControl().catch(() => undefined);
      this.hold(null);
    });
  }

  get mine(): boolean {
    return this.current.get() !== null;
  }

  /** Have control, or throw the reason why not. */
  async ensure(): Promise<void> {
    if (this.mine) return;
    this.asking ??= this.take(false).finally(() => (this.asking = null));
    await this.asking;
  }

  async take(over: boolean): Promise<void> {
    if (this.app.role.get() !== "operator") throw new ApiError(403, "You may watch and press the emergency stop, nothing else");
    this.hold(await api.takeControl(this.name, over));
  }

  async release(): Promise<void> {
    await api.releaseControl();
    this.hold(null);
  }

  /** The server says that it is gone. */
  lost(): void {
    if (this.mine) this.hold(null);
  }

  private hold(lease: Lease | null): void {
    useLease(lease?.key ?? null);
    this.current.set(lease);
  }
}

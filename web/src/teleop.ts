// The teleop socket: open while this page has control; drive input while it is held, and one zero on release.

import type { App } from "./app";
import { Cell } from "./store";
import type { TeleopAnswer, TeleopInput } from "./types";

const SEND_EVERY_MS = 66;
/** A drive that was silent for so long is over: the robot node holds the robot then. */
const SILENT_MS = 300;
const PING_EVERY_MS = 1000;
const FIRST_PINGS_MS = 150;
const RECONNECT_MS = 500;
const MOST_WAITING_BYTES = 4096;
const LOST_CONTROL = 4001;

export interface Wish {
  drive: number;
  turn: number;
}

export class Teleop {
  /** Whether drive input can be sent now. */
  readonly ready = new Cell(false);
  private socket: WebSocket | null = null;
  private seq = 0;
  private wish: Wish = { drive: 0, turn: 0 };
  private timer = 0;
  private sentMs = 0;

  constructor(
    private readonly app: App,
    /** Called when the server refuses a drive: whatever is held must be let go. */
    private readonly onRefused: (detail: string) => void,
    /** Called when this page itself stood still while it drove: the robot is held, and must not go on by itself. */
    private readonly onStalled: () => void,
  ) {
    app.lease.current.watch((lease) => (lease ? this.open(lease.key) : this.close()));
    window.setInterval(() => this.ping(), PING_EVERY_MS);
  }

  /** Drive like this until told otherwise; a zero is sent once. */
  set(wish: Wish): void {
    const before = this.wish;
    this.wish = wish;
    const moves = wish.drive !== 0;
    if (moves && this.timer === 0) {
      this.sentMs = performance.now();
      this.timer = window.setInterval(() => this.repeat(), SEND_EVERY_MS);
    }
    if (!moves) {
      window.clearInterval(this.timer);
      this.timer = 0;
    }
    if (moves || before.drive !== 0) this.send();
  }

  private repeat(): void {
    if (performance.now() - this.sentMs > SILENT_MS) return this.onStalled();
    this.sentMs = performance.now();
    this.send();
  }

  private send(): void {
    const socket = this.socket;
    if (!socket || !this.ready.get()) return;
    // Old input that waits to be sent is worth nothing; a zero always goes.
    if (this.wish.drive !== 0 && socket.bufferedAmount > MOST_WAITING_BYTES) return;
    this.say({ type: "drive", seq: ++this.seq, t_ms: performance.now(), ...this.wish });
  }

  private ping(): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.say({ type: "ping", t_ms: performance.now() });
  }

  private say(message: TeleopInput): void {
    this.socket?.send(JSON.stringify(message));
  }

  private open(key: string): void {
    this.close();
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/api/v1/teleop`);
    this.socket = socket;
    socket.onopen = () => {
      this.say({ type: "hello", lease: key });
      // Several, so that the quickest of them tells the clocks' difference.
      for (const delay of [0, FIRST_PINGS_MS, 2 * FIRST_PINGS_MS]) window.setTimeout(() => this.ping(), delay);
    };
    socket.onmessage = (event: MessageEvent<string>) => this.hear(JSON.parse(event.data) as TeleopAnswer);
    socket.onclose = (event) => {
      if (this.socket === socket) this.dropped(event, key);
    };
  }

  private hear(answer: TeleopAnswer): void {
    if (answer.type === "pong") this.ready.set(true);
    else if (answer.type === "done") this.app.commandMs.set(performance.now() - answer.t_ms);
    else if (answer.type === "refused") this.onRefused(`The drive was refused: ${answer.detail}.`);
  }

  private dropped({ code, reason }: CloseEvent, key: string): void {
    this.socket = null;
    this.ready.set(false);
    if (code === LOST_CONTROL) return this.app.lease.lost();
    // Whoever holds the drive must press again once the connection is back.
    if (reason !== "") this.onRefused(`The drive's connection was closed: ${reason} (${code}). It is opened again.`);
    else if (this.wish.drive !== 0) this.onRefused("The drive was let go: the connection was lost. It is opened again.");
    window.setTimeout(() => this.app.lease.current.get()?.key === key && this.open(key), RECONNECT_MS);
  }

  private close(): void {
    const socket = this.socket;
    this.socket = null;
    this.ready.set(false);
    this.app.commandMs.set(null);
    socket?.close();
  }
}

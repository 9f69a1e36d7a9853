// The teleop socket: open while this page has control; drive input while it is held, and one zero on release.

import type { App } from "./app";
import { Cell } from "../basics/store";
import type { Drive, TeleopAnswer, TeleopInput } from "../types";

const SEND_EVERY_MS = 66;
/** After this silence the robot node holds the robot. Set in runtime/robot/deadman.py; the build takes it from the API's schema. */
declare const DEADMAN_MS: number;
const PING_EVERY_MS = 1000;
const FIRST_PINGS_MS = 150;
const RECONNECT_MS = 500;
const MOST_WAITING_BYTES = 4096;
const LOST_CONTROL = 4001;

export class Teleop {
  /** Whether drive input can be sent now. */
  readonly ready = new Cell(false);
  private socket: WebSocket | null = null;
  private seq = 0;
  private drive: Drive = { drive: 0, turn: 0 };
  private timer = 0;
  private sentMs = 0;

  constructor(
    private readonly app: App,
    /** Called when the server refuses a drive: whatever is held must be released. */
    private readonly onRefused: (detail: string) => void,
    /** Called when this page itself was frozen while it drove: the robot is held, and must not go on by itself. */
    private readonly onStalled: () => void,
  ) {
    app.lease.current.watch((lease) => (lease ? this.open(lease.key) : this.close()));
    window.setInterval(() => this.ping(), PING_EVERY_MS);
  }

  /** Drive like this until the next call; a zero is sent once. */
  set(drive: Drive): void {
    const before = this.drive;
    this.drive = drive;
    const moves = drive.drive !== 0;
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
    if (performance.now() - this.sentMs > DEADMAN_MS) return this.onStalled();
    this.sentMs = performance.now();
    this.send();
  }

  private send(): void {
    const socket = this.socket;
    if (!socket || !this.ready.get()) return;
    // Old input in the queue is useless; a zero is always sent.
    if (this.drive.drive !== 0 && socket.bufferedAmount > MOST_WAITING_BYTES) return;
    this.transmit({ type: "drive", seq: ++this.seq, t_ms: performance.now(), ...this.drive });
  }

  private ping(): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.transmit({ type: "ping", t_ms: performance.now() });
  }

  private transmit(message: TeleopInput): void {
    this.socket?.send(JSON.stringify(message));
  }

  private open(key: string): void {
    this.close();
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/api/v1/teleop`);
    this.socket = socket;
    socket.onopen = () => {
      this.transmit({ type: "hello", lease: key });
      // Several, because the quickest of them gives the difference of the clocks.
      for (const delay of [0, FIRST_PINGS_MS, 2 * FIRST_PINGS_MS]) window.setTimeout(() => this.ping(), delay);
    };
    socket.onmessage = (event: MessageEvent<string>) => this.onAnswer(JSON.parse(event.data) as TeleopAnswer);
    socket.onclose = (event) => {
      if (this.socket === socket) this.onClose(event, key);
    };
  }

  private onAnswer(answer: TeleopAnswer): void {
    if (answer.type === "pong") this.ready.set(true);
    else if (answer.type === "done") this.app.commandMs.set(performance.now() - answer.t_ms);
    else if (answer.type === "refused") this.onRefused(`The drive was refused: ${answer.detail}.`);
  }

  private onClose({ code, reason }: CloseEvent, key: string): void {
    this.socket = null;
    this.ready.set(false);
    if (code === LOST_CONTROL) return this.app.lease.lost();
    // Whoever holds the drive must press again once the connection is back.
    if (reason !== "") this.onRefused(`The drive's connection was closed: ${reason} (${code}). It is opened again.`);
    else if (this.drive.drive !== 0) this.onRefused("The drive was released: the connection was lost. It is opened again.");
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

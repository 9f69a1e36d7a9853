// The deadman input: keys, pad buttons, gamepad. All of it is released when the page cannot be sure to show the robot.

import type { App } from "./app";
import { KeyRepeat } from "../basics/key-repeat";
import { Cell } from "../basics/store";
import type { Drive, RobotState } from "../types";

const DRIVE_KEYS: Record<string, Drive> = {
  KeyW: { drive: 1, turn: 0 },
  KeyS: { drive: -1, turn: 0 },
  KeyA: { drive: 0, turn: 1 },
  KeyD: { drive: 0, turn: -1 },
};
const ARROWS: Record<string, string> = { ArrowUp: "KeyW", ArrowDown: "KeyS", ArrowLeft: "KeyA", ArrowRight: "KeyD" };
/** While one of these is down, the key-up of another key may never come (macOS with Command, window and input switchers). */
const SWALLOWERS = ["Meta", "OS", "Control", "Alt", "AltGraph", "Hyper", "Super", "Process", "Dead"];
const FIELDS = "textarea, select, input:not([type=range])";
const DEAD_ZONE = 0.15;
const STOP_BUTTON = 1; // B, or the circle
const GAMEPAD = "gamepad";
const POLL_MS = 50;
/** The camera image is frozen after four of its usual intervals, within these bounds. */
const FROZEN_MS: [number, number] = [1000, 4000];
const FROZEN_POLLS = 3;

const clip = (value: number): number => Math.max(-1, Math.min(1, value));

export class DeadmanInput {
  readonly drive = new Cell<Drive>({ drive: 0, turn: 0 });
  /** Share of the full pace. */
  speed = 1;
  private readonly held = new Map<string, Drive>();
  private lastFrameMs: number | null = null;
  private intervalMs = 250;
  private frozenPolls = 0;
  /** A stick that was released by force must return to its centre before it counts again. */
  private stickArmed = false;
  private stopWasDown = false;
  private gamepadIndex: number | null = null;
  private readonly repeat = new KeyRepeat();
  private heldBecause: string | null = null;

  constructor(
    private readonly app: App,
    private readonly onStop: (reason: string) => void,
  ) {
    window.addEventListener("blur", () => this.releaseAll("the window lost the focus"));
    document.addEventListener("visibilitychange", () => document.hidden && this.releaseAll("the page is hidden"));
    window.addEventListener("gamepaddisconnected", () => this.releaseAll("the gamepad was unplugged"));
    for (const lost of ["fullscreenchange", "pointerlockchange", "compositionstart", "dragstart", "freeze"])
      document.addEventListener(lost, () => this.releaseAll("something else took the keyboard or the pointer"));
    app.link.watch(({ phase }) => phase !== "live" && this.releaseAll("the link is down"));
    app.state.watch((state) => this.follow(state));
    app.image.on(({ shown_ms }) => this.noteFrame(shown_ms - performance.timeOrigin));
    window.setInterval(() => this.poll(), POLL_MS);
  }

  get gamepad(): string | null {
    return navigator.getGamepads().find((pad) => pad?.connected)?.id ?? null;
  }

  hold(source: string, input: Drive): void {
    if (!this.app.commandable || this.app.state.get()?.estop.latched === true) return;
    if (this.frozen) return this.app.notice.emit({ level: "error", text: "The camera image is frozen: driving waits for it" });
    this.held.set(source, input);
    this.combine();
  }

  release(source: string): void {
    if (this.held.delete(source)) this.combine();
  }

  releaseAll(why: string | null): void {
    this.stickArmed = false;
    if (this.held.size === 0) return;
    this.held.clear();
    this.combine();
    if (why !== null) this.app.notice.emit({ level: "error", text: `The drive was released: ${why}. Release it, then press again.` });
  }

  /** A hold ends the drive here too: nothing goes on by itself when the robot may move again. */
  private follow(state: RobotState | null): void {
    const before = this.heldBecause;
    this.heldBecause = state?.held_because ?? null;
    if (this.held.size === 0) return;
    if (state?.estop.latched === true) this.releaseAll(null);
    else if (this.heldBecause !== null && this.heldBecause !== before) this.releaseAll(`the robot is held (${this.heldBecause})`);
    else if (!this.app.commandable) this.releaseAll("the robot cannot be driven now");
  }

  /** W, A, S, D anywhere but in fields; the arrows where nothing else uses them. */
  listen(target: Window, arrowsFor: (element: Element) => boolean): void {
    const named = (event: KeyboardEvent): string | null => {
      const element = event.target instanceof Element ? event.target : null;
      if (element?.matches(FIELDS)) return null;
      if (event.code in DRIVE_KEYS) return event.code;
      return element && arrowsFor(element) ? (ARROWS[event.code] ?? null) : null;
    };
    const swallowed = (event: KeyboardEvent): boolean => {
      const { key, ctrlKey, altKey, metaKey, isComposing } = event;
      const may = ctrlKey || altKey || metaKey || isComposing || SWALLOWERS.includes(key);
      if (may) this.releaseAll("Command, Ctrl, Alt or an input method may withhold a key-up");
      return may;
    };
    // Before any other listener: on the pad's buttons Enter is held as well.
    target.addEventListener("keydown", (event) => this.repeat.onDown(event), { capture: true });
    target.addEventListener("keydown", (event) => {
      if (swallowed(event)) return;
      const key = named(event);
      if (key === null) return;
      event.preventDefault();
      const input = DRIVE_KEYS[key];
      if (!event.repeat && input) this.hold(event.code, input);
    });
    // In the capture phase, whatever has the focus by now: after a lost key-up the robot would be driven on.
    target.addEventListener("keyup", (event) => this.onKeyUp(event, swallowed(event)), { capture: true });
    target.addEventListener("blur", () => this.releaseAll(null));
    // A menu takes the keyboard and the pointer, and a field the keyboard.
    target.addEventListener("contextmenu", (event) => !event.defaultPrevented && this.releaseAll("a menu was opened"));
    target.addEventListener("focusin", (event) => {
      if (event.target instanceof Element && event.target.matches(FIELDS)) this.releaseAll("a field has the keyboard now");
    });
  }

  private onKeyUp(event: KeyboardEvent, swallowed: boolean): void {
    this.repeat.onUp();
    if (!swallowed) this.release(event.code);
  }

  /** Judged over several polls: a page that was busy itself has images in its queue. */
  private get frozen(): boolean {
    return this.frozenPolls >= FROZEN_POLLS;
  }

  private noteFrame(now: number): void {
    if (this.lastFrameMs !== null) this.intervalMs += 0.1 * (now - this.lastFrameMs - this.intervalMs);
    this.lastFrameMs = now;
    this.frozenPolls = 0;
  }

  private poll(): void {
    const limit = Math.min(Math.max(4 * this.intervalMs, FROZEN_MS[0]), FROZEN_MS[1]);
    const old = this.lastFrameMs !== null && performance.now() - this.lastFrameMs > limit;
    this.frozenPolls = old ? this.frozenPolls + 1 : 0;
    if (this.held.size > 0 && this.frozen) this.releaseAll("the camera image is frozen");
    const key = this.repeat.lost(performance.now());
    if (key !== null && (this.held.has(key) || key.endsWith("Enter"))) this.releaseAll("the key's repeats have stopped without a key-up");
    this.pollGamepad();
  }

  private pollGamepad(): void {
    const pad = navigator.getGamepads().find((candidate) => candidate?.connected) ?? null;
    // Disconnected without an event, or replaced by another one.
    if (this.gamepadIndex !== null && pad?.index !== this.gamepadIndex) {
      if (this.held.has(GAMEPAD)) this.releaseAll("the gamepad has gone");
      this.stickArmed = this.stopWasDown = false;
    }
    this.gamepadIndex = pad?.index ?? null;
    if (pad) this.readGamepad(pad);
  }

  private readGamepad(pad: Gamepad): void {
    const down = pad.buttons[STOP_BUTTON]?.pressed === true;
    if (down && !this.stopWasDown) this.onStop("Gamepad button pressed");
    this.stopWasDown = down;
    const pressed = (index: number) => (pad.buttons[index]?.pressed === true ? 1 : 0);
    const axis = (index: number) => {
      const value = pad.axes[index] ?? 0;
      return Math.abs(value) < DEAD_ZONE ? 0 : value;
    };
    const drive = clip(-axis(1) + pressed(12) - pressed(13));
    const turn = clip(-axis(0) + pressed(14) - pressed(15));
    if (drive === 0 && turn === 0) {
      this.stickArmed = true;
      this.release(GAMEPAD);
    } else if (this.stickArmed && document.hasFocus()) this.hold(GAMEPAD, { drive, turn });
  }

  private combine(): void {
    let drive = 0;
    let turn = 0;
    for (const input of this.held.values()) {
      drive += input.drive;
      turn += input.turn;
    }
    this.drive.set({ drive: clip(drive) * this.speed, turn: clip(turn) });
  }
}

// Notices a key that was released without a key-up: its repeats stop. Some systems swallow key-ups (macOS while Command is
// down, menus, gestures that take the keyboard), and a drive must not hang on an event that may never come.

/** Longer than any stutter of a browser that gets on. */
const LEAST_SILENCE_MS = 500;
const INTERVALS = 4;
/** Judged over several polls: a page that was busy itself has key events in its queue. */
const LATE_LOOKS = 3;

/** Follows the key pressed last, the only one that repeats. Where a keyboard has never repeated, nothing is concluded. */
export class KeyRepeat {
  private code: string | null = null;
  private lastMs = 0;
  /** Between repeats of this press; null before the second one. */
  private intervalMs: number | null = null;
  /** From press to first repeat, the longest seen on this machine. */
  private delayMs: number | null = null;
  private repeats = 0;
  private lateLooks = 0;

  onDown({ code, repeat, timeStamp }: KeyboardEvent): void {
    if (code !== this.code || !repeat) {
      this.code = code;
      this.repeats = 0;
      this.intervalMs = null;
    } else {
      const gapMs = timeStamp - this.lastMs;
      if (this.repeats === 0) this.delayMs = Math.max(this.delayMs ?? 0, gapMs);
      else this.intervalMs = this.intervalMs === null ? gapMs : Math.max(gapMs, 0.8 * this.intervalMs);
      this.repeats++;
    }
    this.lastMs = timeStamp;
    this.lateLooks = 0;
  }

  /** The key-up of any key may end the repeats of another that stays down. */
  onUp(): void {
    this.code = null;
  }

  /** The code of the key whose repeats have stopped, once, else null; to be asked at short intervals. */
  lost(nowMs: number): string | null {
    if (this.code === null) return null;
    this.lateLooks = nowMs - this.lastMs > this.limitMs() ? this.lateLooks + 1 : 0;
    if (this.lateLooks < LATE_LOOKS) return null;
    const { code } = this;
    this.code = null;
    return code;
  }

  private limitMs(): number {
    if (this.intervalMs !== null) return Math.max(INTERVALS * this.intervalMs, LEAST_SILENCE_MS);
    return this.delayMs === null ? Infinity : 2 * this.delayMs + LEAST_SILENCE_MS;
  }
}

// One rhythm for all that is drawn without an event asking for it: the browser then makes one picture of it all, which
// counts where a processor draws. Faster than five times a second nobody reads a number.

const BEAT_MS = 100;

export class Redraw {
  private readonly entries: { beats: number; draw: () => void }[] = [];
  private beat = 0;

  constructor() {
    window.setInterval(() => {
      if (!document.hidden) requestAnimationFrame(() => this.draw());
    }, BEAT_MS);
  }

  /** Call `draw` every so many ms, rounded to whole beats, while the page is seen. */
  every(ms: number, draw: () => void): void {
    this.entries.push({ beats: Math.max(1, Math.round(ms / BEAT_MS)), draw });
  }

  private draw(): void {
    this.beat++;
    for (const { beats, draw } of this.entries) if (this.beat % beats === 0) draw();
  }
}

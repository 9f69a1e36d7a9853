// One rhythm for all that is drawn without an event asking for it: the browser then draws one frame of it all, which
// counts where a processor draws. Faster than five times a second nobody reads a number.

const STEP_MS = 100;

export class Redraw {
  private readonly entries: { steps: number; draw: () => void }[] = [];
  private step = 0;

  constructor() {
    window.setInterval(() => {
      if (!document.hidden) requestAnimationFrame(() => this.draw());
    }, STEP_MS);
  }

  /** Call `draw` every so many ms, rounded to whole steps, while the page is seen. */
  every(ms: number, draw: () => void): void {
    this.entries.push({ steps: Math.max(1, Math.round(ms / STEP_MS)), draw });
  }

  private draw(): void {
    this.step++;
    for (const { steps, draw } of this.entries) if (this.step % steps === 0) draw();
  }
}

// Draws camera frames and the tracked features on them, onto canvases that the page has handed over.

import type { Features, Frame } from "../types";

export interface Colours {
  inlier: string;
  outlier: string;
}

/** Decode a JPEG; without a Blob where that is possible, because making one waits for another process. */
async function decode(jpeg: Uint8Array<ArrayBuffer>): Promise<VideoFrame | ImageBitmap> {
  const type = "image/jpeg";
  // Pages that come over plain HTTP from another machine have no ImageDecoder.
  if (!("ImageDecoder" in self)) return createImageBitmap(new Blob([jpeg], { type }));
  const decoder = new ImageDecoder({ type, data: jpeg });
  const { image } = await decoder.decode();
  decoder.close();
  return image;
}

/** Draws the newest frame only: while one is being decoded, a newer one replaces the one that waits.
 *
 * A frame is shown at once, with the newest features known, which are often those of the frame before; its own follow.
 * An image that is to be turned upright waits for them, because they say how far it is rolled.
 */
export class Painter {
  private marked = true;
  private colours: Colours = { inlier: "lime", outlier: "red" };
  private level = false;
  private held: Frame | null = null;
  private waiting: Frame | null = null;
  private busy = false;
  private features: Features | null = null;
  private shownSeq = -1;
  /** Counts the sessions, so that an image that is still being decoded is not drawn into the next one. */
  private epoch = 0;

  constructor(
    private readonly image: OffscreenCanvas,
    private readonly overlay: OffscreenCanvas,
    private readonly shown: (frame: Frame, rollDeg: number | null) => void,
  ) {}

  show(frame: Frame): void {
    if (this.level && (this.features === null || this.features.seq < frame.seq)) this.held = frame;
    else this.draw(frame);
  }

  /** Take the features of a frame, which is shown or waits for them. */
  follow(features: Features): void {
    this.features = features;
    if (this.held && this.held.seq <= features.seq) this.draw(this.held);
    // Where a newer image is on the screen already, they wait for the next: one change of the screen for both.
    else if (features.seq >= this.shownSeq || !this.waiting) this.drawTracks();
  }

  setLevel(level: boolean): void {
    this.level = level;
    if (!level) this.held = null;
  }

  private draw(frame: Frame): void {
    this.held = null;
    this.waiting = frame;
    if (!this.busy) void this.drain();
  }

  /** Say whether the features are drawn, and in what colours. */
  mark(marked: boolean, colours: Colours): void {
    this.marked = marked;
    this.colours = colours;
    this.drawTracks();
  }

  /** Wipe the image and forget what waits, as another session begins. */
  clear(): void {
    this.held = this.waiting = this.features = null;
    this.shownSeq = -1;
    this.epoch++;
    for (const canvas of [this.image, this.overlay]) canvas.getContext("2d")?.clearRect(0, 0, canvas.width, canvas.height);
  }

  private async drain(): Promise<void> {
    this.busy = true;
    while (this.waiting) {
      const frame = this.waiting;
      const epoch = this.epoch;
      this.waiting = null;
      try {
        const image = await decode(frame.jpeg);
        if (epoch === this.epoch) this.paint(frame, image);
        else image.close();
      } catch (error) {
        console.warn("a camera image could not be decoded", error);
      }
    }
    this.busy = false;
  }

  private paint(frame: Frame, image: VideoFrame | ImageBitmap): void {
    for (const canvas of [this.image, this.overlay]) {
      if (canvas.width !== frame.width) canvas.width = frame.width;
      if (canvas.height !== frame.height) canvas.height = frame.height;
    }
    this.image.getContext("2d", { alpha: false })?.drawImage(image, 0, 0, frame.width, frame.height);
    image.close();
    this.shownSeq = frame.seq;
    this.drawTracks();
    this.shown(frame, this.features?.roll_deg ?? null);
  }

  /** Circles for what the estimator uses, crosses for what it rejects: the shape tells as well as the colour. */
  private drawTracks(): void {
    const context = this.overlay.getContext("2d");
    if (!context) return;
    context.clearRect(0, 0, this.overlay.width, this.overlay.height);
    if (!this.marked || this.features === null) return;
    const size = Math.max(3, this.overlay.width / 150);
    context.lineWidth = Math.max(1.5, this.overlay.width / 320);
    for (const inlier of [1, 0]) {
      context.beginPath();
      for (const [x, y, kind] of this.features.tracks) {
        if (kind !== inlier) continue;
        if (inlier) {
          context.moveTo(x + size, y);
          context.arc(x, y, size, 0, 2 * Math.PI);
        } else {
          context.moveTo(x - size, y - size);
          context.lineTo(x + size, y + size);
          context.moveTo(x + size, y - size);
          context.lineTo(x - size, y + size);
        }
      }
      context.strokeStyle = inlier ? this.colours.inlier : this.colours.outlier;
      context.stroke();
    }
  }
}

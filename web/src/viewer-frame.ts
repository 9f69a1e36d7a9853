// Runs in the 3D view's frame before viser does: drawing must never crowd out the operator's controls.
//
// viser draws as often as the browser lets it. Without a graphics card one frame takes a good part of a second, the
// page and the simulator wait for it, and a stop would come late. So after each frame the view pauses, the longer
// the longer the frame took; and what costs most and shows least is left out where a processor draws.
{
  const FREE_MS = 20; // a frame this quick comes from a graphics card, and nobody waits for it
  const PAUSE = 12; // times the frame's own duration
  const PAUSE_IN_HAND = 1; // while the view is being turned
  const LONGEST_PAUSE_MS = 3000;
  const SLOW_MS = 120; // fewer points are drawn until a frame takes less than this,
  const QUICK_MS = 50; // and more again when it takes less than this
  const LEAST_DETAIL = 0.02;
  const FIRST_DETAIL = 0.15;
  const PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;

  const nativeRequest = window.requestAnimationFrame.bind(window);
  let waiting = new Map<number, FrameRequestCallback>();
  let lastId = 0;
  let asked = false;
  let inHand = false;
  let notBefore = 0;
  let detail = 1; // share of the map's points that are drawn, for scene.ts
  const publish = () => ((window as { snakeslamDetail?: number }).snakeslamDetail = detail);

  function ask(): void {
    if (asked) return;
    asked = true;
    const pause = notBefore - performance.now();
    if (pause > 1) setTimeout(() => nativeRequest(draw), pause);
    else nativeRequest(draw);
  }

  function draw(now: DOMHighResTimeStamp): void {
    const callbacks = waiting;
    waiting = new Map();
    asked = false;
    notBefore = Infinity;
    const begun = performance.now();
    // The browser asks for the next frame when this one is done.
    nativeRequest(() => {
      const took = performance.now() - begun;
      const pause = took < FREE_MS ? 0 : Math.min(took * (inHand ? PAUSE_IN_HAND : PAUSE), LONGEST_PAUSE_MS);
      notBefore = performance.now() + pause;
      if (took > SLOW_MS) detail = Math.max(LEAST_DETAIL, detail / 1.5);
      else if (took < QUICK_MS) detail = Math.min(1, detail * 1.1);
      publish();
      if (waiting.size) ask();
    });
    for (const callback of callbacks.values())
      try {
        callback(now);
      } catch (error) {
        reportError(error);
      }
  }

  window.requestAnimationFrame = (callback) => {
    waiting.set(++lastId, callback);
    if (notBefore !== Infinity) ask();
    return lastId;
  };
  window.cancelAnimationFrame = (id) => void waiting.delete(id);
  window.addEventListener("pointerdown", () => (inHand = true), { capture: true });
  for (const end of ["pointerup", "pointercancel"])
    window.addEventListener(end, () => (inHand = false), { capture: true });

  function drawnByProcessor(): boolean {
    const gl = document.createElement("canvas").getContext("webgl2");
    const info = gl?.getExtension("WEBGL_debug_renderer_info");
    const name = gl && info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
    return PROCESSOR.test(name);
  }

  if (drawnByProcessor()) {
    const native = HTMLCanvasElement.prototype.getContext as (kind: string, options?: object) => RenderingContext | null;
    HTMLCanvasElement.prototype.getContext = function (this: HTMLCanvasElement, kind: string, options?: object) {
      if (!kind.startsWith("webgl")) return native.call(this, kind, options);
      return native.call(this, kind, { ...options, antialias: false });
    } as typeof HTMLCanvasElement.prototype.getContext;
    Object.defineProperty(window, "devicePixelRatio", { get: () => 0.5 });
    // The first frame comes soon and coarse.
    detail = FIRST_DETAIL;
    publish();
  }
}

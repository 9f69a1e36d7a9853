// Building elements without a framework.

type Child = Node | string | null | false;
type Value = string | number | boolean | null | ((event: never) => void);

/** An element with attributes (functions become listeners, false and null are left out) and children. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Record<string, Value> = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.replace(/^on/, ""), value as EventListener);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null) element.setAttribute(name, String(value));
  }
  element.append(...children.filter((child): child is Node | string => child !== null && child !== false));
  return element;
}

const ICONS = {
  check: '<path d="M4 10.500l4 4 8-9"/>',
  warn: '<path d="M10 3l8 14H2z"/><path d="M10 8v4.200M10 14.600v.200"/>',
  cross: '<path d="M5 5l10 10M15 5L5 15"/>',
  dots: '<path d="M4 10h.010M10 10h.010M16 10h.010"/>',
  play: '<path d="M6 4l10 6-10 6z" fill="currentColor"/>',
  square: '<rect x="5" y="5" width="10" height="10" rx="1.500" fill="currentColor"/>',
  pause: '<path d="M7 5v10M13 5v10"/>',
  stepBack: '<path d="M14 5l-7 5 7 5z" fill="currentColor"/><path d="M5 5v10"/>',
  stepAhead: '<path d="M6 5l7 5-7 5z" fill="currentColor"/><path d="M15 5v10"/>',
  octagon: '<path d="M7 2.500h6L17.500 7v6L13 17.500H7L2.500 13V7z" fill="currentColor" stroke="none"/>',
  sun: '<circle cx="10" cy="10" r="3.500"/><path d="M10 2v2M10 16v2M2 10h2M16 10h2M4.300 4.300l1.400 1.400M14.300 14.300l1.400 1.400M15.700 4.300l-1.400 1.400M5.700 14.300l-1.400 1.400"/>',
  moon: '<path d="M16 12.500A7 7 0 0 1 7.500 4a7 7 0 1 0 8.500 8.500z"/>',
  help: '<circle cx="10" cy="10" r="7.500"/><path d="M7.800 7.800a2.200 2.200 0 1 1 3.200 2c-.700.400-1 .800-1 1.600M10 14.200v.100"/>',
  chevron: '<path d="M6 8l4 4 4-4"/>',
  film: '<rect x="3" y="4.500" width="14" height="11" rx="1.500"/><path d="M6.500 4.500v11M13.500 4.500v11M3 10h3.500M13.500 10H17"/>',
  cube: '<path d="M10 2.800l6.500 3.600v7.200L10 17.200l-6.500-3.600V6.400z"/><path d="M3.500 6.400L10 10l6.500-3.600M10 10v7.200"/>',
  up: '<path d="M10 16V4M5 9l5-5 5 5"/>',
  down: '<path d="M10 4v12M5 11l5 5 5-5"/>',
  left: '<path d="M7 4L3 8l4 4M3 8h8.500a4.500 4.500 0 0 1 0 9H9"/>',
  right: '<path d="M13 4l4 4-4 4M17 8H8.500a4.500 4.500 0 0 0 0 9H11"/>',
  snake: '<path d="M2.500 12.500c2-6 4.500-6 6.200-2s4 4 5.200.500c.700-2 1.600-3 3-3.300"/><circle cx="17" cy="7.600" r=".9" fill="currentColor"/>',
} as const;

export type IconName = keyof typeof ICONS;

/** A decorative line icon in the text's colour. */
export function icon(name: IconName): SVGSVGElement {
  const template = document.createElement("template");
  template.innerHTML =
    '<svg class="icon" viewBox="0 0 20 20" fill="none" stroke="currentColor" stroke-width="1.700" ' +
    `stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">${ICONS[name]}</svg>`;
  return template.content.firstChild as SVGSVGElement;
}

/** Set text only when it differs, so that live regions and layout stay quiet. */
export function setText(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

/** The element of the page's skeleton with this id. */
export function byId(id: string): HTMLElement {
  const element = document.getElementById(id);
  if (!element) throw new Error(`index.html has no #${id}`);
  return element;
}

const colours = new Map<string, string>();
let coloursTheme: string | undefined;

/** The value of a theme's CSS custom property, for what is drawn on a canvas; kept, as asking lays the page out. */
export function cssColour(name: string): string {
  const theme = document.documentElement.dataset["theme"] ?? "";
  if (theme !== coloursTheme) colours.clear();
  coloursTheme = theme;
  let value = colours.get(name);
  if (value === undefined) {
    value = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    colours.set(name, value);
  }
  return value;
}

interface Size {
  width: number;
  height: number;
}

const sizes = new WeakMap<Element, Size>();
const resizes = new ResizeObserver((entries) => {
  for (const { target } of entries) measure(target);
});

function measure(element: Element): Size {
  const size = { width: element.clientWidth, height: element.clientHeight };
  sizes.set(element, size);
  return size;
}

/** An element's inner size, measured when it changes only, as measuring lays the page out. */
export function sizeOf(element: Element): Size {
  const known = sizes.get(element);
  if (known) return known;
  resizes.observe(element);
  return measure(element);
}

/** Match a canvas's pixels to its size on the page; true when it was resized. */
export function fitCanvas(canvas: HTMLCanvasElement): boolean {
  const scale = Math.min(window.devicePixelRatio || 1, 2);
  const shown = sizeOf(canvas);
  const width = Math.round(shown.width * scale);
  const height = Math.round(shown.height * scale);
  if (canvas.width === width && canvas.height === height) return false;
  canvas.width = width;
  canvas.height = height;
  return true;
}

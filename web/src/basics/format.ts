// Numbers for people: a fixed number of decimals, a true minus sign, a dash for what is unknown.

const UNKNOWN = "\u2013";
const MINUS = "\u2212";

export function fixed(value: number | null | undefined, decimals: number): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const text = value.toFixed(decimals);
  const rounded = Number(text) === 0 ? (0).toFixed(decimals) : text;
  return rounded.replace("-", MINUS);
}

export function scaled(value: number | null | undefined, factor: number, decimals: number): string {
  return fixed(value === null || value === undefined ? value : value * factor, decimals);
}

/** 1234567 as "1.23 M", 12345 as "12.3 k". */
export function count(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  if (value >= 1e6) return `${(value / 1e6).toFixed(2)} M`;
  if (value >= 1e4) return `${(value / 1e3).toFixed(1)} k`;
  return String(Math.round(value));
}

/** Seconds as m:ss.t. */
export function clock(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return UNKNOWN;
  const tenths = Math.max(0, Math.floor(seconds * 10));
  const minutes = Math.floor(tenths / 600);
  return `${minutes}:${((tenths % 600) / 10).toFixed(1).padStart(4, "0")}`;
}

export function age(milliseconds: number): string {
  const seconds = milliseconds / 1000;
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 120) return `${Math.round(seconds)} s`;
  return `${Math.round(seconds / 60)} min`;
}

/** A unit of the catalogue as it is written on the page. */
export function unitSign(unit: string): string {
  return { deg: "\u00b0", "pi rad": "\u03c0 rad", "deg/s": "\u00b0/s" }[unit] ?? unit;
}

export const capitalised = (text: string): string => text.charAt(0).toUpperCase() + text.slice(1);

/** The shortest decimals that still show a slider's step. */
export function stepDecimals(step: number): number {
  return Math.max(0, Math.min(4, Math.ceil(-Math.log10(step) - 1e-9)));
}

// Errors in the operator's words: never the browser's own, which name neither what failed nor what to do.

import { ApiError } from "./api";

/** One line for an error of any kind. */
export function errorLine(error: unknown): string {
  if (error instanceof ApiError) return error.message;
  const detail = error instanceof Error ? error.message : String(error);
  return `This page made a mistake (${detail}). Reload it; the robot does not depend on it.`;
}

/** Report what no caller has caught: a page with a fault must not look as if all were well. */
export function watchFailures(report: (error: unknown) => void): void {
  window.addEventListener("error", (event) => {
    // Resources that fail to load have no error object, and ResizeObserver's warning is none of ours.
    if (event.error instanceof Error) report(event.error);
  });
  window.addEventListener("unhandledrejection", (event) => report(event.reason));
}

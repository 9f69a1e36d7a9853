// Dark or light: the system's preference until the operator chooses.

const KEY = "snakeslam-theme";

export type Theme = "dark" | "light";

function stored(): Theme | null {
  try {
    const value = localStorage.getItem(KEY);
    return value === "dark" || value === "light" ? value : null;
  } catch {
    return null; // storage may be switched off; the system's preference then stands
  }
}

function chosenTheme(): Theme {
  return stored() ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
}

/** The theme on the page now. */
export function shownTheme(): Theme {
  return document.documentElement.dataset["theme"] === "light" ? "light" : "dark";
}

function show(): void {
  document.documentElement.dataset["theme"] = chosenTheme();
}

/** Apply the theme now and whenever the system's preference changes. */
export function startTheme(onChange: () => void): void {
  show();
  matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => {
    show();
    onChange();
  });
}

export function toggleTheme(): void {
  const next = shownTheme() === "dark" ? "light" : "dark";
  try {
    localStorage.setItem(KEY, next);
  } catch {
    // Not kept for the next visit, but shown now.
  }
  document.documentElement.dataset["theme"] = next;
}

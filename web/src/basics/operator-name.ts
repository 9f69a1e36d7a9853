// The name under which others see this page: the operator's own, kept in this browser, else browser, system and a mark.

const KEY = "snakeslam-name";
/** The server takes so many characters and no control characters. */
export const LONGEST_NAME = 40;

/** How others see a page whose operator has given no name. */
function madeUpName(): string {
  const agent = navigator.userAgent;
  const browser = ["Firefox", "Edg", "Chrome", "Safari"].find((name) => agent.includes(name)) ?? "Browser";
  const system = ["Android", "iPhone", "iPad", "Windows", "Mac", "Linux"].find((name) => agent.includes(name)) ?? "";
  const mark = crypto.getRandomValues(new Uint8Array(1))[0] ?? 0;
  return `${browser === "Edg" ? "Edge" : browser} ${system} ${mark.toString(16).padStart(2, "0")}`.replace(/ +/g, " ");
}

/** What can be sent of a text: one line without control characters or halves of surrogate pairs. */
function cleaned(text: string): string {
  const line = text.replace(/\p{Cc}|\p{Cs}/gu, " ").replace(/\s+/g, " ").trim();
  return Array.from(line).slice(0, LONGEST_NAME).join("").trim();
}

function stored(): string {
  try {
    return cleaned(localStorage.getItem(KEY) ?? "");
  } catch {
    return ""; // storage switched off
  }
}

export class OperatorName {
  private readonly fallback = madeUpName();
  private chosen = stored();

  get text(): string {
    return this.chosen === "" ? this.fallback : this.chosen;
  }

  /** Keep another name; an empty one goes back to the made-up name. */
  set(text: string): void {
    this.chosen = cleaned(text);
    try {
      localStorage.setItem(KEY, this.chosen);
    } catch {
      // Not kept for the next visit, but used from now on.
    }
  }
}

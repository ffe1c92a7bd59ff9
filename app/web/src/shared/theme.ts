/** Light or dark: what the system asks for, unless the visitor chose. `public/theme.js` sets it before the first paint. */
import { signal } from "@preact/signals";

export type Theme = "light" | "dark";
const CHOICE = "versant.theme";

export const theme = signal<Theme>(document.documentElement.dataset["theme"] === "dark" ? "dark" : "light");

function show(chosen: Theme): void {
  document.documentElement.dataset["theme"] = chosen;
  theme.value = chosen;
}

/** Change to the other and remember it. */
export function switchTheme(): void {
  const chosen = theme.value === "dark" ? "light" : "dark";
  localStorage.setItem(CHOICE, chosen);
  show(chosen);
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (event) => {
  if (localStorage.getItem(CHOICE) === null) show(event.matches ? "dark" : "light");
});

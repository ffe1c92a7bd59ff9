/** Short messages at the edge of the page, read out by screen readers; those of errors stay until they are closed. */
import { signal } from "@preact/signals";
import { ApiProblem } from "./api";
import { t } from "./texts";

interface Message {
  id: number;
  kind: "done" | "error";
  text: string;
}

const messages = signal<Message[]>([]);
const SHOWN_MS = 6000;
let last = 0;

function add(kind: Message["kind"], text: string): number {
  last += 1;
  messages.value = [...messages.value, { id: last, kind, text }];
  return last;
}

function drop(id: number): void {
  messages.value = messages.value.filter((one) => one.id !== id);
}

/** Say what was done. */
export function tellDone(text: string): void {
  const id = add("done", text);
  setTimeout(() => drop(id), SHOWN_MS);
}

/** What an error says to people. */
export function errorText(error: unknown): string {
  return error instanceof ApiProblem ? error.message : t("problem.unexpected", { what: String(error) });
}

/** Say what went wrong. */
export function tellError(error: unknown): void {
  add("error", errorText(error));
}

/** Where messages appear. */
export function Messages() {
  return (
    <div class="messages" role="status" aria-live="polite">
      {messages.value.map((one) => (
        <p key={one.id} class={`message ${one.kind}`}>
          <span>{one.text}</span>
          <button type="button" class="quiet" aria-label={t("page.close")} onClick={() => drop(one.id)}>
            ×
          </button>
        </p>
      ))}
    </div>
  );
}

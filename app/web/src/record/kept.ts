/** What is kept on this device: sent and then deleted, downloaded, or deleted. */
import { computed, effect, signal } from "@preact/signals";
import { tellDone } from "../shared/Messages";
import { whenTold } from "../shared/tabs";
import { t } from "../shared/texts";
import { add, items } from "../upload/queue";
import { begin as rememberUploads } from "../upload/reload";
import type { Recording } from "./keeper";
import { fileName, fileOf } from "./log";
import { elsewhere, lookElsewhere } from "./recorder";
import { shelf } from "./shelf";

export const kept = signal<Recording[] | null>(null);
/** Why the browser's storage could not be read. */
export const unreadable = signal<unknown>(null);

/** Fewer positions are no drive. */
export const LEAST_POSITIONS = 2;

/** Names of what is on its way. */
const sending = computed(() => {
  const under = items.value.filter((item) => ["waiting", "sending"].includes(item.phase.value));
  return new Set(under.map((item) => item.name));
});

export const isSending = (recording: Recording) => sending.value.has(fileName(recording));

/** Look what is kept. */
export async function look(): Promise<void> {
  try {
    await lookElsewhere();
    kept.value = elsewhere.value ? [] : await shelf.all();
    unreadable.value = null;
  } catch (error) {
    unreadable.value = error;
  }
}

/** Once, by the page. */
export function begin(): void {
  rememberUploads();
  whenTold(() => void look());
  document.addEventListener("visibilitychange", () => void look());
  void look();
  effect(() => {
    const arrived = new Set(
      items.value
        .filter((item) => item.phase.value !== "sending" && item.driveId !== "")
        .map((item) => item.name),
    );
    for (const recording of kept.value ?? []) if (arrived.has(fileName(recording))) void confirmed(recording);
  });
}

/** The service has it: nothing is kept of it any more. */
async function confirmed(recording: Recording): Promise<void> {
  kept.value = (kept.value ?? []).filter((one) => one.id !== recording.id);
  await shelf.remove(recording.id);
  tellDone(t("record.arrived"));
}

async function fileFor(recording: Recording): Promise<File> {
  return fileOf(recording, await shelf.chunks(recording.id));
}

/** Hand it to the service. From now on nothing comes to it: sent again, it is the same drive. */
export async function send(recording: Recording): Promise<void> {
  await shelf.put({ ...recording, sealed: true });
  const file = await fileFor(recording);
  await look();
  // A transfer that was refused makes room for this one.
  items.value = items.value.filter((item) => item.name !== file.name || item.driveId !== "");
  add([[file]], new URLSearchParams({ grouping: "one" }));
}

/** Give it as a file; it stays kept. */
export async function download(recording: Recording): Promise<void> {
  const file = await fileFor(recording);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = file.name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/** Delete it from this device. */
export async function forget(recording: Recording): Promise<void> {
  await shelf.remove(recording.id);
  await look();
}

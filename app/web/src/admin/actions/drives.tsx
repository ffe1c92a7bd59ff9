/** Many drives again, or removed: what it would do is asked for first and shown, then done, then followed. */
import { signal } from "@preact/signals";
import { confirmed } from "../../shared/Confirm";
import { distance, size } from "../../shared/format";
import { tellDone, tellError } from "../../shared/Messages";
import { failureText } from "../../shared/remarks";
import { inWords } from "../../shared/said";
import { currentLanguage, t } from "../../shared/texts";
import { withQuery } from "../links";
import { reader } from "../page_state";
import { ask } from "../requests";
import type { BatchAccepted, Removal } from "../types";

export type Selection = Record<string, string>;

const KEPT_AS = "versant.batches";

function remembered(): number[] {
  try {
    return (JSON.parse(sessionStorage.getItem(KEPT_AS) ?? "[]") as unknown[]).filter(
      (one): one is number => typeof one === "number",
    );
  } catch {
    return [];
  }
}

/** Batches that were asked for here; the newest first. */
export const batches = signal<number[]>(remembered());

function keep(numbers: number[]): void {
  batches.value = numbers.slice(0, 10);
  try {
    sessionStorage.setItem(KEPT_AS, JSON.stringify(batches.value));
  } catch {
    // storage may be forbidden
  }
}

export function forgetBatch(batch: number): void {
  keep(batches.value.filter((one) => one !== batch));
}

function numberOf(accepted: BatchAccepted): number | null {
  const monitor = accepted.links.find((one) => one.rel === "monitor");
  const text = monitor ? new URL(monitor.href).searchParams.get("batch") : null;
  return text === null ? null : Number(text);
}

function skippedText(skipped: Record<string, number>): string {
  return Object.entries(skipped)
    .map(([kind, count]) => `${failureText(kind)}: ${count.toLocaleString(currentLanguage())}`)
    .join(", ");
}

/** Show how many drives would be computed again, ask, do it. Resolves to what there is to say if none would. */
export async function reprocess(selection: Selection, whom: string): Promise<string | null> {
  try {
    const address = "/v1/drives/reprocess";
    const would = await ask<BatchAccepted>("POST", withQuery(address, { ...selection, dry_run: true }));
    if (would.queued === 0) return would.note ? inWords(would.note, would.note_said) : t("admin.again.none");
    const skipped = skippedText(would.skipped);
    const yes = await confirmed({
      title: t("admin.again.ask", { n: would.queued }),
      what: (
        <>
          <p>{t("admin.again.what", { whom })}</p>
          <p>
            {would.method === null
              ? t("admin.again.own_method")
              : t("admin.again.by_method", { method: would.method })}
          </p>
          {skipped && <p>{t("admin.again.skipped", { skipped })}</p>}
        </>
      ),
      action: t("admin.again.do", { n: would.queued }),
    });
    if (!yes) return null;
    const accepted = await ask<BatchAccepted>("POST", withQuery(address, selection));
    const batch = numberOf(accepted);
    if (batch !== null) keep([batch, ...batches.value.filter((one) => one !== batch)]);
    tellDone(t("admin.again.done", { n: accepted.queued }));
    reader.readNow("/v1/");
  } catch (error) {
    tellError(error);
  }
  return null;
}

/** Show which drives would be removed, ask, do it. Resolves to what there is to say if none would. */
export async function remove(selection: Selection, whom: string): Promise<string | null> {
  try {
    const address = "/v1/drives/remove";
    const would = await ask<Removal>("POST", withQuery(address, { ...selection, dry_run: true }));
    if (would.drives === 0) return t("admin.remove.none");
    const yes = await confirmed({
      title: t("admin.remove.ask", { n: would.drives }),
      what: (
        <>
          <p>
            {t("admin.remove.what", {
              whom,
              km: distance(would.km * 1000),
              bytes: size(would.uploaded_bytes),
            })}
          </p>
        </>
      ),
      action: t("admin.remove.do", { n: would.drives }),
      destructive: true,
    });
    if (!yes) return null;
    await ask<unknown>("POST", withQuery(address, selection));
    tellDone(t("admin.remove.done", { n: would.drives }));
    reader.readNow("/v1/");
  } catch (error) {
    tellError(error);
  }
  return null;
}

/** Ask, then take what still waits of a batch out of the queue. */
export async function cancelBatch(batch: number, waiting: number): Promise<void> {
  const yes = await confirmed({
    title: t("admin.batch.cancel_ask", { batch }),
    what: <p>{t("admin.batch.cancel_what", { n: waiting })}</p>,
    action: t("admin.batch.cancel"),
    destructive: true,
  });
  if (!yes) return;
  try {
    await ask<unknown>("DELETE", withQuery("/v1/drives/reprocess", { batch }));
    tellDone(t("admin.batch.cancelled", { batch }));
    reader.readNow("/v1/");
  } catch (error) {
    tellError(error);
  }
}

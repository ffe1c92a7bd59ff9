/** What can be done with the drives that are chosen: computed again, removed, two of them compared. */
import { signal } from "@preact/signals";
import { api, got } from "../shared/api";
import { confirmed } from "../shared/Confirm";
import type { Drive } from "../shared/drives";
import { distance, size } from "../shared/format";
import { errorText, tellDone, tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import { drives, load, selected } from "./state";

const NAMED = 5;
const busy = signal(false);

function Named({ chosen, text }: { chosen: Drive[]; text: string }) {
  return (
    <>
      <p>{text}</p>
      <ul>
        {chosen.slice(0, NAMED).map((drive) => (
          <li key={drive.id}>{drive.filename}</li>
        ))}
        {chosen.length > NAMED && <li>{t("drives.and_more", { n: chosen.length - NAMED })}</li>}
      </ul>
    </>
  );
}

/** One after the other: each is a request of its own, and what fails is said once for all. */
async function forEach(
  chosen: Drive[],
  act: (drive: Drive) => Promise<unknown>,
  done: (n: number) => string,
) {
  busy.value = true;
  const faults: unknown[] = [];
  for (const drive of chosen) {
    try {
      await act(drive);
    } catch (error) {
      faults.push(error);
    }
  }
  busy.value = false;
  selected.value = new Set();
  if (chosen.length > faults.length) tellDone(done(chosen.length - faults.length));
  if (faults.length > 0)
    tellError(new Error(t("drives.some_failed", { n: faults.length, why: errorText(faults[0]) })));
  await load();
}

async function reprocess(chosen: Drive[]): Promise<void> {
  const yes = await confirmed({
    title: t("drives.again_title", { n: chosen.length }),
    what: <Named chosen={chosen} text={t("drives.again_what", { n: chosen.length })} />,
    action: t("drives.again"),
  });
  if (!yes) return;
  const ask = (drive: Drive) =>
    got(api.POST("/v1/drives/{drive_id}/reprocess", { params: { path: { drive_id: drive.id } } }));
  await forEach(chosen, ask, (n) => t("drives.again_done", { n }));
}

async function remove(chosen: Drive[]): Promise<void> {
  const sum = (of: (drive: Drive) => number | null) =>
    chosen.reduce((total, drive) => total + (of(drive) ?? 0), 0);
  const text = t("drives.delete_what", {
    n: chosen.length,
    length: distance(sum((drive) => drive.distance_m)),
    bytes: size(sum((drive) => drive.size_bytes)),
    published: chosen.filter((drive) => drive.report !== null).length,
  });
  const yes = await confirmed({
    title: t("drives.delete_title", { n: chosen.length }),
    what: <Named chosen={chosen} text={text} />,
    action: t("drives.delete"),
    destructive: true,
  });
  if (!yes) return;
  const ask = (drive: Drive) =>
    got(api.DELETE("/v1/drives/{drive_id}", { params: { path: { drive_id: drive.id } } }));
  await forEach(chosen, ask, (n) => t("drives.delete_done", { n }));
}

/** The buttons; nothing while nothing is chosen. */
export function Selection() {
  const chosen = (drives.value ?? []).filter((drive) => selected.value.has(drive.id));
  const [one, other] = chosen;
  const usable = chosen.filter((drive) => drive.status !== "cancelled");
  return (
    <div class="selection">
      <p role="status" class={chosen.length > 0 ? "" : "quiet-text"}>
        {chosen.length > 0 ? t("drives.chosen", { n: chosen.length }) : t("drives.choose_hint")}
      </p>
      {chosen.length > 0 && (
        <div class="tools">
          {chosen.length === 2 && one && other && (
            <a class="button" href={`/drives/${one.id}?with=${other.id}`}>
              {t("drives.compare")}
            </a>
          )}
          <button
            type="button"
            disabled={busy.value || usable.length === 0}
            onClick={() => void reprocess(usable)}
          >
            {t("drives.again")}
          </button>
          <button
            type="button"
            class="danger"
            disabled={busy.value || usable.length === 0}
            onClick={() => void remove(usable)}
          >
            {t("drives.delete")}
          </button>
          {chosen.length === 1 && <span class="quiet-text">{t("drives.compare_hint")}</span>}
        </div>
      )}
    </div>
  );
}

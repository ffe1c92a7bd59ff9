/** One upload in the list: how far it is in words and as a bar, why it failed, and what can be done now. */
import { confirmed } from "../shared/Confirm";
import { mapOf, stageText } from "../shared/drives";
import { distance, duration, size } from "../shared/format";
import { reasonOf, remarksOf } from "../shared/remarks";
import { inWords } from "../shared/said";
import { t } from "../shared/texts";
import { WaitsForRoads } from "../shared/Waits";
import { Columns, mayLackColumns } from "./Columns";
import {
  type Item,
  isLeftOut,
  items,
  mayRetry,
  type Phase,
  remove,
  removeDrive,
  retry,
  takeApart,
} from "./queue";

function words(item: Item): string {
  const phase: Phase = item.phase.value;
  const drive = item.drive.value;
  if (phase === "waiting") return t(item.tries > 0 ? "upload.waits_again" : "upload.waits");
  if (phase === "sending" && item.lost.value)
    return t("upload.lost", { sent: size(item.sent.value), all: size(item.size) });
  if (phase === "sending")
    return item.sent.value < item.size
      ? t("upload.sending", { sent: size(item.sent.value), all: size(item.size) })
      : t("upload.storing");
  if (phase === "refused") return t(isLeftOut(item) ? "upload.not_used" : "upload.refused");
  if (phase === "running") return stageText(drive?.stage);
  if (phase === "done") {
    const took = (Date.parse(drive?.finished_at ?? "") - Date.parse(drive?.started_at ?? "")) / 1000;
    return t("upload.is_done", { length: distance(drive?.distance_m), time: duration(took) });
  }
  return t(`upload.is_${phase}`);
}

async function askAndRemove(item: Item): Promise<void> {
  const yes = await confirmed({
    title: t("upload.cancel_title", { name: item.name }),
    what: t("upload.cancel_what"),
    action: t("upload.cancel_action"),
    destructive: true,
  });
  if (yes) await removeDrive(item);
}

function Bar({ item }: { item: Item }) {
  const phase = item.phase.value;
  if (phase === "sending")
    return (
      <progress
        max={item.size}
        value={item.sent.value}
        aria-label={t("upload.transfer_of", { name: item.name })}
      />
    );
  if (phase === "running")
    return (
      <progress
        max={1}
        value={item.drive.value?.progress ?? 0}
        aria-label={t("upload.processing_of", { name: item.name })}
      />
    );
  return null;
}

function Actions({ item }: { item: Item }) {
  const phase = item.phase.value;
  const drive = item.drive.value;
  const name = item.name;
  const over = ["refused", "done", "failed", "roads", "cancelled"].includes(phase);
  return (
    <div class="actions">
      {item.driveId && phase !== "cancelled" && (
        <a class="button" href={`/drives/${item.driveId}`} aria-label={t("upload.open_named", { name })}>
          {t("upload.open")}
        </a>
      )}
      {phase === "done" && drive?.bbox && (
        <a class="button" href={mapOf(drive.bbox)} aria-label={t("upload.map_named", { name })}>
          {t("upload.map")}
        </a>
      )}
      {mayRetry(item) && (
        <button type="button" aria-label={t("upload.again_named", { name })} onClick={() => void retry(item)}>
          {t(phase === "failed" ? "upload.process_again" : "upload.again")}
        </button>
      )}
      {(phase === "queued" || phase === "running") && !item.known.value && (
        <button
          type="button"
          aria-label={t("upload.cancel_named", { name })}
          onClick={() => void askAndRemove(item)}
        >
          {t("upload.cancel_action")}
        </button>
      )}
      {(phase === "waiting" || phase === "sending") && (
        <button type="button" aria-label={t("upload.cancel_named", { name })} onClick={() => remove(item)}>
          {t("page.cancel")}
        </button>
      )}
      {over && (
        <button
          type="button"
          class="quiet"
          aria-label={t("upload.forget_named", { name })}
          title={t("upload.forget")}
          onClick={() => remove(item)}
        >
          ×
        </button>
      )}
    </div>
  );
}

/** Files that were taken for one drive, and whether they are. */
function Doubts({ item }: { item: Item }) {
  const phase = item.phase.value;
  if (item.unclear.value.length === 0 || phase === "cancelled") return null;
  return (
    <section class="doubt" aria-label={t("upload.unclear_label", { name: item.name })}>
      {item.unclear.value.map(({ files, why }) => (
        <p key={why}>
          {t(why === "continues" ? "upload.unclear_continues" : "upload.unclear_overlaps", {
            files: files.join(", "),
          })}
        </p>
      ))}
      <div class="buttons">
        <button
          type="button"
          onClick={() => {
            item.unclear.value = [];
          }}
        >
          {t("upload.stays_one")}
        </button>
        <button type="button" onClick={() => takeApart(item)}>
          {t("upload.make_several")}
        </button>
      </div>
    </section>
  );
}

/** Whether it waits for roads that nothing before it in the list waits for: what would help is said once. */
function isFirstToWait(item: Item): boolean {
  const wanted = (one: Item) => one.drive.value?.waits_for?.extracts?.join();
  const waiting = items.value.filter((one) => one.phase.value === "roads");
  return waiting.find((one) => wanted(one) === wanted(item)) === item;
}

/** The row. */
export function Row({ item }: { item: Item }) {
  const phase = item.phase.value;
  const drive = item.drive.value;
  const warnings = remarksOf(drive?.report);
  const lacks = phase === "refused" && mayLackColumns(item);
  const reason =
    phase === "refused" ? item.problem.value?.message : drive?.failure && reasonOf(drive.failure);
  return (
    <li class={`upload-row ${phase}`}>
      <div class="what">
        <p class="name">
          <strong>{item.name}</strong>{" "}
          <span class="quiet-text">
            {item.part || item.archive ? t("upload.in", { name: item.origin }) : size(item.size)}
          </span>
        </p>
        <p class="state">
          <span class="mark" aria-hidden="true" /> {words(item)}
          {item.known.value && <span class="quiet-text"> {t("upload.known")}</span>}
        </p>
        <Bar item={item} />
        {(phase === "refused" || phase === "failed") && !lacks && <p class="reason">{reason}</p>}
        {isFirstToWait(item) && drive && <WaitsForRoads drive={drive} />}
        {phase === "done" && warnings.length > 0 && (
          <details>
            <summary class="warn-text">{t("upload.warnings", { n: warnings.length })}</summary>
            <ul>
              {warnings.map(({ text }) => (
                <li key={text}>{text}</li>
              ))}
            </ul>
          </details>
        )}
        {phase !== "refused" && item.leftOut.value.length > 0 && (
          <details>
            <summary class="quiet-text">{t("upload.unused", { n: item.leftOut.value.length })}</summary>
            <ul>
              {item.leftOut.value.map(({ file, reason: why, said }) => (
                <li key={file}>
                  {file}: {inWords(why, said)}
                </li>
              ))}
            </ul>
          </details>
        )}
        <Doubts item={item} />
        {lacks && <Columns item={item} />}
      </div>
      <Actions item={item} />
    </li>
  );
}

/** What can be done with a drive: process it again, try another method, remove it. */
import { useSignal } from "@preact/signals";
import { api, got, problemOf } from "../shared/api";
import { confirmed } from "../shared/Confirm";
import { moment, number, size } from "../shared/format";
import { tellDone, tellError } from "../shared/Messages";
import { MethodForm } from "../shared/MethodForm";
import { chosenQuery, type MethodChosen, type Methods, USUAL, usable } from "../shared/methods";
import { isNoLog } from "../shared/remarks";
import { t } from "../shared/texts";
import { addressOf, type Drive } from "./data";
import { driveId, leave, look, lookAtTrials } from "./load";
import { segments } from "./state";

async function post(part: string, query: URLSearchParams): Promise<void> {
  const asked = query.toString();
  const response = await fetch(`${addressOf(driveId, part)}${asked ? `?${asked}` : ""}`, { method: "POST" });
  if (!response.ok) throw await problemOf(response);
}

async function reprocess(query: URLSearchParams): Promise<void> {
  await post("/reprocess", query);
  tellDone(t("drive.again.asked"));
  await look();
}

/** Process as it was asked for: what a failed drive is given once its cause is gone. */
export function RetryButton() {
  const busy = useSignal(false);
  const retry = async () => {
    busy.value = true;
    await reprocess(new URLSearchParams()).catch(tellError);
    busy.value = false;
  };
  return (
    <button type="button" class="primary" disabled={busy.value} onClick={() => void retry()}>
      {t("drive.failed.retry")}
    </button>
  );
}

/** A trial of every method or another run of the drive, by one form. */
function AgainForm({ drive: now }: { drive: Drive }) {
  const chosen = useSignal<MethodChosen>(USUAL);
  const known = useSignal<Methods | null>(null);
  const busy = useSignal(false);
  const asked = async (action: () => Promise<void>) => {
    busy.value = true;
    await action().catch(tellError);
    busy.value = false;
  };
  const again = async () => {
    const query = chosenQuery(chosen.value, known.value);
    const figures = { n: segments.value.length, method: query.get("method") ?? now.method };
    if (
      await confirmed({
        title: t("drive.again.title"),
        what: <p>{t("drive.again.what", figures)}</p>,
        action: t("drive.again.action"),
      })
    )
      await asked(() => reprocess(query));
  };
  const trial = () =>
    asked(async () => {
      const query = chosenQuery(chosen.value, known.value);
      // A trial is of a method by name: without one the service would take its own default, which is shown as such.
      if (!query.has("method") && known.value) query.set("method", known.value.default);
      await post("/trials", query);
      tellDone(t("drive.trial.asked"));
      await lookAtTrials();
    });
  const fits = usable(chosen.value, known.value);
  return (
    <>
      <MethodForm
        chosen={chosen.value}
        choose={(one) => {
          chosen.value = one;
        }}
        known={(all) => {
          known.value = all;
        }}
      />
      <div class="buttons start">
        <button type="button" class="primary" disabled={busy.value || !fits} onClick={() => void trial()}>
          {t("drive.trial.action")}
        </button>
        <button type="button" disabled={busy.value || !fits} onClick={() => void again()}>
          {t("drive.again.button")}
        </button>
      </div>
      <p class="quiet-text">{t("drive.again.help")}</p>
    </>
  );
}

async function remove(now: Drive): Promise<void> {
  const agreed = await confirmed({
    title: t("drive.delete.title", { name: now.filename }),
    what: (
      <>
        <p>{t("drive.delete.what")}</p>
        <ul>
          <li>{t("drive.delete.log", { size: size(now.size_bytes) })}</li>
          {now.epochs !== null && <li>{t("drive.delete.track", { epochs: number(now.epochs) })}</li>}
          {segments.value.length > 0 && <li>{t("drive.delete.segments", { n: segments.value.length })}</li>}
        </ul>
        <p>{t("drive.delete.final")}</p>
      </>
    ),
    action: t("drive.delete.action"),
    destructive: true,
  });
  if (!agreed) return;
  try {
    await got(api.DELETE("/v1/drives/{drive_id}", { params: { path: { drive_id: now.id } } }));
    leave();
  } catch (error) {
    tellError(error);
  }
}

export function Actions({ drive: now }: { drive: Drive }) {
  const open = useSignal(false);
  return (
    <section class="card" aria-labelledby="actions">
      <h2 id="actions">{t("drive.actions")}</h2>
      {now.log_deleted_at !== null ? (
        <p>{t("drive.log_deleted", { when: moment(now.log_deleted_at) })}</p>
      ) : isNoLog(now) ? null : now.status === "done" || now.status === "failed" ? (
        <details onToggle={(event) => (open.value = event.currentTarget.open)}>
          <summary>{t("drive.again.summary")}</summary>
          {open.value && <AgainForm drive={now} />}
        </details>
      ) : (
        <p class="quiet-text">{t("drive.again.later")}</p>
      )}
      <div class="buttons start">
        <button type="button" class="danger" onClick={() => void remove(now)}>
          {t("drive.delete.button")}
        </button>
      </div>
    </section>
  );
}

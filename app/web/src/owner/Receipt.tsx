/** The receipt of a removal, for whoever has its address; it is asked for again until all is removed. */
import { useEffect } from "preact/hooks";
import { dayText, number, size, UNKNOWN } from "../shared/format";
import { t } from "../shared/texts";
import { load, receipt } from "./state";

const LOOK_EVERY_MS = 5000;
const COUNTS = ["drives", "bytes", "trials", "keys", "sessions", "exports", "webhooks", "zones"] as const;

function day(on: string | null): string {
  return on === null ? UNKNOWN : dayText(on);
}

export function Receipt() {
  const now = receipt.value;
  useEffect(() => {
    if (now?.state !== "running") return;
    const timer = setTimeout(() => void load(), LOOK_EVERY_MS);
    return () => clearTimeout(timer);
  }, [now]);
  if (now === null) return <p class="quiet-text">{t("owner.loading")}</p>;
  const done = now.state === "done";
  return (
    <>
      <p role="status">{t(done ? "owner.receipt_done" : "owner.receipt_running")}</p>
      <section class="card" aria-labelledby="removed">
        <h2 id="removed">{t("owner.removed")}</h2>
        <dl class="facts">
          {COUNTS.map((one) => (
            <div key={one}>
              <dt>{t(`owner.counts.${one}`)}</dt>
              <dd>{one === "bytes" ? size(now.removed.bytes) : number(now.removed[one])}</dd>
            </div>
          ))}
          <div>
            <dt>{t("owner.asked_on")}</dt>
            <dd>{day(now.asked_on)}</dd>
          </div>
          <div>
            <dt>{t("owner.ended_on")}</dt>
            <dd>{day(now.ended_on)}</dd>
          </div>
          {!done && (
            <div>
              <dt>{t("owner.left")}</dt>
              <dd>{number(now.drives_left)}</dd>
            </div>
          )}
        </dl>
        {now.audit_rows_kept !== null && now.audit_rows_kept > 0 && (
          <p>{t("owner.audit_kept", { n: now.audit_rows_kept })}</p>
        )}
        <p>{t("owner.copies")}</p>
      </section>
      <p>
        <b>{t("owner.receipt_keep")}</b>
      </p>
    </>
  );
}

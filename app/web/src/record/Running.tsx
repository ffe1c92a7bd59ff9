/** The recording while it runs: figures that people glance at, and what goes wrong in plain words. */
import type { ComponentChildren } from "preact";
import { useEffect } from "preact/hooks";
import { distance, number, size, UNKNOWN } from "../shared/format";
import { t } from "../shared/texts";
import { clock } from "./clock";
import { fix, hidden_ms, motion, screen, silent_ms, stop, totals, trouble, unkept } from "./recorder";

/** A second or two out of sight is a glance at the clock. */
const SHORT_MS = 2000;
const POOR_M = 30;

function Figure({
  name,
  warn = false,
  children,
}: {
  name: string;
  warn?: boolean;
  children: ComponentChildren;
}) {
  return (
    <div>
      <dt>{name}</dt>
      <dd class={warn ? "warn-text" : ""}>{children}</dd>
    </div>
  );
}

function Figures() {
  const all = totals.value;
  const accuracy = fix.value?.h_acc_m;
  return (
    <dl class="figures">
      <Figure name={t("record.time")}>{clock(all.ran_ms)}</Figure>
      <Figure name={t("record.distance")}>{distance(all.distance_m)}</Figure>
      <Figure name={t("record.positions")}>{number(all.positions)}</Figure>
      <Figure name={t("record.accuracy")} warn={accuracy !== undefined && accuracy > POOR_M}>
        {accuracy === undefined ? UNKNOWN : `± ${number(accuracy)} m`}
      </Figure>
      <Figure name={t("record.motion")} warn={motion.value === "none" || motion.value === "refused"}>
        {t(`record.motion_is.${motion.value}`)}
      </Figure>
      <Figure name={t("record.screen")} warn={screen.value !== "held"}>
        {t(`record.screen_is.${screen.value}`)}
      </Figure>
      <Figure name={t("record.kept_size")}>{size(all.bytes)}</Figure>
      <Figure name={t("record.gaps")} warn={all.gaps > 0}>
        {all.gaps === 0
          ? t("record.no_gaps")
          : t("record.gaps_are", { n: all.gaps, longest: clock(all.longest_gap_ms) })}
      </Figure>
    </dl>
  );
}

/** The worst comes first. */
function warnings(): string[] {
  const said: string[] = [];
  if (trouble.value === "denied") said.push(t("record.denied"));
  if (unkept.value !== null) said.push(t("record.unkept", { why: unkept.value }));
  if (trouble.value !== "denied" && silent_ms.value !== null)
    said.push(t(fix.value === null ? "record.no_position" : "record.silent"));
  if (hidden_ms.value > SHORT_MS) said.push(t("record.was_hidden", { time: clock(hidden_ms.value) }));
  if (screen.value === "unsupported") said.push(t("record.screen_by_hand"));
  return said;
}

export function Running({ stopped }: { stopped: () => Promise<void> }) {
  useEffect(() => {
    const asks = (event: BeforeUnloadEvent) => event.preventDefault();
    addEventListener("beforeunload", asks);
    return () => removeEventListener("beforeunload", asks);
  }, []);
  return (
    <section class="card running" aria-labelledby="running">
      <h2 id="running">
        <span class="mark" aria-hidden="true" /> {t(fix.value === null ? "record.waits" : "record.runs")}
      </h2>
      <div role="status">
        {warnings().map((text) => (
          <p key={text} class="warning">
            {text}
          </p>
        ))}
      </div>
      <Figures />
      <button type="button" class="primary begin" onClick={() => void stop().then(stopped)}>
        {t("record.stop")}
      </button>
      <p class="quiet-text">{t("record.is_kept")}</p>
    </section>
  );
}

/** Imports, removals and settling: what is under way, what is planned and waits for a yes, and what was done. */
import { useEffect, useRef, useState } from "preact/hooks";
import { moment, number } from "../../shared/format";
import { reasonOf } from "../../shared/remarks";
import { inWords, type Said, term } from "../../shared/said";
import { hasText, t } from "../../shared/texts";
import { approve, destroys, drop, groundChanged, OPERATIONS } from "../actions/operations";
import { useReading } from "../page_state";
import { Progress } from "../parts/Progress";
import { Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { Operation } from "../types";

const PLANNED_FIRST = new Set(["import-roads", "remove-region", "remove-raster"]);
const OPEN = new Set(["queued", "running", "planned"]);

function kindText(one: Operation): string {
  const key = `admin.operations.kinds.${one.kind.replaceAll("-", "_")}`;
  return hasText(key) ? t(key) : one.kind;
}

function titleOf(one: Operation): string {
  return one.subject && one.subject !== "map" ? `${kindText(one)}: ${one.subject}` : kindText(one);
}

function sentenceOf(plan: Record<string, unknown> | null): string | null {
  if (typeof plan?.["sentence"] !== "string") return null;
  return inWords(plan["sentence"], plan["sentence_said"] as Said | null | undefined);
}

// Worth a look though it is none; others are left out then.
const ALWAYS = new Set(["kept", "moved", "dropped", "added", "measured_lost", "drives_again"]);

/** Figures that there are names for, in the order of the service. */
function figuresOf(plan: Record<string, unknown>): [string, number][] {
  return Object.entries(plan).filter(
    (one): one is [string, number] =>
      typeof one[1] === "number" && hasText(`admin.plan.${one[0]}`) && (one[1] !== 0 || ALWAYS.has(one[0])),
  );
}

function Plan({ plan }: { plan: Record<string, unknown> }) {
  const sentence = sentenceOf(plan);
  return (
    <>
      {sentence && <p>{sentence}</p>}
      <dl class="figures">
        {figuresOf(plan).map(([name, value]) => {
          const key = `admin.plan.${name}`;
          return (
            <div key={name}>
              <dt>{hasText(key) ? t(key) : name}</dt>
              <dd class={name === "measured_lost" && value > 0 ? "error-text" : undefined}>
                {number(value)}
              </dd>
            </div>
          );
        })}
      </dl>
    </>
  );
}

/** Whether nothing of it is done yet: it waits, is planned, or is being planned. */
function mayEnd(one: Operation): boolean {
  return one.status !== "running" || (PLANNED_FIRST.has(one.kind) && one.plan === null);
}

function Card({ one }: { one: Operation }) {
  const title = titleOf(one);
  return (
    <section class={`card operation ${one.status}`} aria-label={title}>
      <h3>
        {title} – {t(`admin.status.${one.status}`)}
      </h3>
      <p class="quiet-text">{t("admin.operations.asked", { at: moment(one.created_at) })}</p>
      {one.status === "running" && (
        <>
          <Progress share={one.progress} label={title} />
          {one.stage && <p>{term(one.stage)}</p>}
        </>
      )}
      {one.status === "planned" && <p>{t("admin.operations.planned")}</p>}
      {one.plan && <Plan plan={one.plan} />}
      <div class="buttons">
        {mayEnd(one) && (
          <button type="button" onClick={() => void drop(one)}>
            {t(one.status === "planned" ? "admin.operations.drop" : "admin.operations.cancel")}
          </button>
        )}
        {one.status === "planned" && (
          <button
            type="button"
            class={destroys(one) ? "danger" : "primary"}
            onClick={() => void approve(one)}
          >
            {t(destroys(one) ? "admin.operations.approve_asking" : "admin.operations.approve")}
          </button>
        )}
      </div>
    </section>
  );
}

function Outcome({ one }: { one: Operation }) {
  if (one.failure) return <span class="error-text">{reasonOf(one.failure)}</span>;
  return <>{sentenceOf(one.result) ?? sentenceOf(one.plan) ?? "–"}</>;
}

export function Operations() {
  const [everyS, setEvery] = useState(5);
  const reading = useReading<{ operations: Operation[] }>(`${OPERATIONS}?limit=30`, everyS);
  const ended = (reading.data.value?.operations ?? [])
    .filter((one) => !OPEN.has(one.status))
    .map((one) => one.id)
    .join();
  const before = useRef<string | null>(null);
  const known = reading.data.value !== null;
  useEffect(() => {
    if (!known) return;
    if (before.current !== null && before.current !== ended) groundChanged();
    before.current = ended;
  }, [known, ended]);
  return (
    <Loaded of={reading}>
      {({ operations }) => {
        const open = operations.filter((one) => OPEN.has(one.status));
        const wanted = open.some((one) => one.status !== "planned") ? 2 : 10;
        if (wanted !== everyS) setEvery(wanted);
        return (
          <div id="operations">
            <h3>{t("admin.operations.title")}</h3>
            {open.map((one) => (
              <Card key={one.id} one={one} />
            ))}
            <Table
              caption={t("admin.operations.latest")}
              none={open.length > 0 ? t("admin.operations.no_others") : t("admin.operations.none")}
              rows={operations.filter((one) => !OPEN.has(one.status))}
              most={8}
              columns={[
                {
                  title: t("admin.operations.what"),
                  cell: (one) => <a href={`${OPERATIONS}/${one.id}`}>{titleOf(one)}</a>,
                },
                { title: t("admin.operations.status"), cell: (one) => t(`admin.status.${one.status}`) },
                { title: t("admin.operations.ended"), cell: (one) => moment(one.finished_at) },
                { title: t("admin.operations.outcome"), cell: (one) => <Outcome one={one} /> },
              ]}
            />
          </div>
        );
      }}
    </Loaded>
  );
}

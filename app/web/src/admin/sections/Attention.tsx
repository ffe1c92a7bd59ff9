/** What needs a person, the most urgent first; each with what to do and the way there. */

import { useState } from "preact/hooks";
import { duration, number } from "../../shared/format";
import { failureText } from "../../shared/remarks";
import { inWords } from "../../shared/said";
import { hasText, t } from "../../shared/texts";
import type texts from "../../texts/en.json";
import { remove, reprocess } from "../actions/drives";
import { firstMoment, ownAddress } from "../links";
import { useQuery } from "../page_state";
import { Loaded } from "../parts/Section";
import type { Attention as Row } from "../types";

// Where on this page something can be done about it.
const SECTIONS: Record<string, keyof typeof texts.admin.parts> = {
  worker: "queue",
  wait: "queue",
  cell: "queue",
  disk: "room",
  failed: "failures",
  "operation-planned": "import",
  "operation-failed": "import",
};

// So far back the service looks for failures (`app.ops.admin.attention`).
const FAILED_DAYS = 7;

// What would help drives that failed so: roads, or to be gone.
const LACK_ROADS = new Set(["no-roads", "no-match"]);
const NO_LOGS = new Set(["unknown-format", "empty-log", "malformed-log", "bad-log"]);

/** Failed drives of one reason: what helps, which asks first. */
function FailedActs({ row }: { row: Row }) {
  const [message, setMessage] = useState<string | null>(null);
  const kind = new URLSearchParams(ownAddress(row.link)?.split("?")[1] ?? "").get("failure");
  if (kind === null) return null;
  const selection = { which: "failed", failure: kind, created_after: firstMoment(FAILED_DAYS) };
  const words = failureText(kind);
  const whom = t("admin.failures.whom", { kind: words, n: FAILED_DAYS });
  return (
    <>
      {LACK_ROADS.has(kind) && (
        <a class="button" href="#import">
          {t("admin.import.roads")}
        </a>
      )}
      {row.severity === "act" && (
        <button type="button" onClick={() => void reprocess(selection, whom).then(setMessage)}>
          {t("admin.attention.retry", { kind: words })}
        </button>
      )}
      {NO_LOGS.has(kind) && (
        <button type="button" class="danger" onClick={() => void remove(selection, whom).then(setMessage)}>
          {t("admin.attention.remove", { kind: words })}
        </button>
      )}
      {message && <span role="status">{message}</span>}
    </>
  );
}

function Item({ row }: { row: Row }) {
  const kind = `admin.attention.kinds.${row.kind.replaceAll("-", "_")}`;
  const [title, todo] = [`${kind}.title`, `${kind}.todo`];
  const name = hasText(title) ? t(title) : row.what;
  const list = ownAddress(row.link);
  const section = SECTIONS[row.kind];
  return (
    <li class={row.severity}>
      <h3>
        <span class="severity">{t(`admin.attention.${row.severity}`)}</span> {name}
        {row.count > 1 && <span class="count"> · {number(row.count)}</span>}
      </h3>
      <p>{inWords(row.what, row.said)}</p>
      {hasText(todo) && <p>{t(todo)}</p>}
      <p class="facts">
        {row.oldest_s !== null && (
          <span>{t("admin.attention.oldest", { time: duration(row.oldest_s) })}</span>
        )}
        {list && (
          <a href={list} aria-label={t("admin.attention.list_of", { title: name })}>
            {t("admin.attention.list")}
          </a>
        )}
        {row.kind === "failed" && <FailedActs row={row} />}
        {row.kind === "roads" && (
          <a class="button" href="#import">
            {t("admin.import.roads")}
          </a>
        )}
        {row.kind === "operation-planned" ? (
          <a class="button" href="#operations">
            {t("admin.attention.plan")}
          </a>
        ) : (
          section && (
            <a href={`#${section}`}>{t("admin.attention.there", { title: t(`admin.parts.${section}`) })}</a>
          )
        )}
      </p>
    </li>
  );
}

export function Attention() {
  const reading = useQuery<Row>("attention", 10);
  return (
    <Loaded of={reading}>
      {({ rows }) => (
        <>
          <p class="unseen" role="status">
            {t("admin.attention.status", { n: rows.length })}
          </p>
          {rows.length === 0 ? (
            <p class="calm">{t("admin.attention.none")}</p>
          ) : (
            <ul class="attention">
              {rows.map((row) => (
                <Item key={`${row.kind} ${row.what}`} row={row} />
              ))}
            </ul>
          )}
        </>
      )}
    </Loaded>
  );
}

/** The drives: a table, or cards where there is no room for one. */
import { type Drive, stageText } from "../shared/drives";
import { distance, moment, number } from "../shared/format";
import { failureText, reasonOf, remarksOf } from "../shared/remarks";
import { t } from "../shared/texts";
import { WaitsForRoads, waitsForRoads } from "../shared/Waits";
import { sortedBy } from "./Filters";
import { drives, go, loading, order, type Sort, selected, sort } from "./state";

const COLUMNS: [string, Sort | null][] = [
  ["filename", "filename"],
  ["drive_time", "drive_time"],
  ["distance_m", "distance_m"],
  ["method", null],
  ["status", "status"],
  ["warnings", null],
  ["created_at", "created_at"],
];

function Heading({ name, by }: { name: string; by: Sort | null }) {
  const text = t(`drives.column.${name}` as "drives.column.method");
  const numeric = name === "distance_m" || name === "warnings" ? "number" : "";
  if (by === null)
    return (
      <th scope="col" class={numeric}>
        {text}
      </th>
    );
  const chosen = sort.value === by;
  const way = order.value === "asc" ? "ascending" : "descending";
  const turned = order.value === "asc" ? "desc" : "asc";
  const first = by === "filename" || by === "status" ? "asc" : "desc";
  return (
    <th scope="col" class={numeric} aria-sort={chosen ? way : undefined}>
      <button type="button" class="sorter" onClick={() => go(sortedBy(by, chosen ? turned : first))}>
        {text} <span aria-hidden="true">{chosen ? (way === "ascending" ? "▲" : "▼") : "↕"}</span>
      </button>
    </th>
  );
}

function Status({ drive }: { drive: Drive }) {
  if (drive.status === "running")
    return (
      <>
        <span class="state running">{stageText(drive.stage)}</span>
        <progress
          max={1}
          value={drive.progress}
          aria-label={t("drives.progress_of", { name: drive.filename })}
        />
      </>
    );
  if (waitsForRoads(drive))
    return (
      <>
        <span class="state roads">{t("roads.waits")}</span>
        <details>
          <summary aria-label={t("roads.what_named", { name: drive.filename })}>{t("roads.what")}</summary>
          <WaitsForRoads drive={drive} />
        </details>
      </>
    );
  if (drive.status === "failed" && drive.failure)
    return (
      <>
        <span class="state failed">{failureText(drive.failure.kind)}</span>
        <details>
          <summary aria-label={t("drives.why_named", { name: drive.filename })}>{t("drives.why")}</summary>
          <p class="reason">{reasonOf(drive.failure)}</p>
        </details>
      </>
    );
  return <span class={`state ${drive.status}`}>{t(`drives.is.${drive.status}`)}</span>;
}

function choose(id: string, chosen: boolean): void {
  const next = new Set(selected.value);
  if (chosen) next.add(id);
  else next.delete(id);
  selected.value = next;
}

interface CellProps {
  name: string;
  kind?: "number" | "time";
  unknown?: boolean;
  children: preact.ComponentChildren;
}

function Cell({ name, kind, unknown, children }: CellProps) {
  return (
    <td class={`${kind ?? ""}${unknown ? " unknown" : ""}`}>
      <span class="phone-only label" aria-hidden="true">
        {t(`drives.column.${name}` as "drives.column.method")}
      </span>
      <span class="value">{children}</span>
    </td>
  );
}

function Row({ drive }: { drive: Drive }) {
  const remarks = remarksOf(drive.report).length;
  return (
    <tr>
      <td class="chooser">
        <input
          type="checkbox"
          aria-label={t("drives.choose_named", { name: drive.filename })}
          checked={selected.value.has(drive.id)}
          onChange={(event) => choose(drive.id, event.currentTarget.checked)}
        />
      </td>
      <th scope="row">
        <a href={`/drives/${drive.id}`}>{drive.filename}</a>
      </th>
      <Cell name="drive_time" kind="time" unknown={drive.drive_time === null}>
        {moment(drive.drive_time)}
      </Cell>
      <Cell name="distance_m" kind="number" unknown={drive.distance_m === null}>
        {distance(drive.distance_m)}
      </Cell>
      <Cell name="method">{drive.method}</Cell>
      <Cell name="status">
        <Status drive={drive} />
      </Cell>
      <Cell name="warnings" kind="number" unknown={remarks === 0}>
        {number(drive.report ? remarks : null)}
      </Cell>
      <Cell name="created_at" kind="time">
        {moment(drive.created_at)}
      </Cell>
    </tr>
  );
}

/** The table. */
export function Table() {
  const shown = drives.value ?? [];
  const all = shown.length > 0 && shown.every((drive) => selected.value.has(drive.id));
  return (
    <div class="wide">
      <table class="drives" aria-busy={loading.value}>
        <caption class="unseen">{t("drives.caption", { n: shown.length })}</caption>
        <thead>
          <tr>
            <th scope="col" class="chooser">
              <input
                type="checkbox"
                aria-label={t("drives.choose_all")}
                checked={all}
                onChange={(event) => {
                  selected.value = new Set(event.currentTarget.checked ? shown.map((drive) => drive.id) : []);
                }}
              />
            </th>
            {COLUMNS.map(([name, by]) => (
              <Heading key={name} name={name} by={by} />
            ))}
          </tr>
        </thead>
        <tbody>
          {shown.map((drive) => (
            <Row key={drive.id} drive={drive} />
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Lets people say what the columns of their CSV are, where it was refused for columns that it lacks. */
import { useEffect, useState } from "preact/hooks";
import { ColumnTable } from "../columns/ColumnTable";
import { inWords, type LogColumn, type Named } from "../columns/corrected";
import { problemOf } from "../shared/api";
import { tellError } from "../shared/Messages";
import { methods } from "../shared/methods";
import { t } from "../shared/texts";
import { type Item, retry } from "./queue";
import { opened } from "./zip";

const ENOUGH_BYTES = 64 * 1024;

/** Whether that may be why an item was refused. */
export function mayLackColumns(item: Item): boolean {
  const problem = item.problem.value;
  return (
    item.archive === "" &&
    item.files.length === 1 &&
    problem?.status === 422 &&
    (problem.type ?? "").endsWith("/malformed-log")
  );
}

/** What the service would take the columns of a file as, by its beginning and what was said of them. */
async function columnsOf(file: File, named: Named): Promise<LogColumn[]> {
  const said = Object.entries(named).map(([ours, theirs]) => ["columns", `${ours}=${theirs}`]);
  const response = await fetch(`/v1/drives/columns?${new URLSearchParams(said)}`, {
    method: "POST",
    headers: { "Content-Type": "application/octet-stream" },
    body: file.slice(0, ENOUGH_BYTES),
  });
  if (!response.ok) throw await problemOf(response);
  return ((await response.json()) as { columns: LogColumn[] }).columns;
}

/** What no column is taken as, of that which a drive must have. */
function lacking(columns: LogColumn[]): string[] {
  const taken = columns.map((one) => one.taken_as ?? "");
  const timed = taken.includes("time_s") || taken.includes("time");
  return [...(timed ? [] : ["time"]), ...["lat_deg", "lon_deg"].filter((one) => !taken.includes(one))];
}

/** Why the file was refused, in plain words where these are columns, and the form. */
export function Columns({ item }: { item: Item }) {
  const [ours, setOurs] = useState<string[]>([]);
  const [columns, setColumns] = useState<LogColumn[]>([]);
  useEffect(() => {
    const first = opened(item.files).then(([file]) => (file ? columnsOf(file, item.columns) : []));
    Promise.all([methods(), first]).then(([known, found]) => {
      setOurs(known.columns);
      setColumns(found);
    }, tellError);
  }, [item]);
  const missing = lacking(columns);
  if (columns.length === 0 || missing.length === 0)
    return <p class="reason">{item.problem.value?.message}</p>;
  return (
    <section class="columns" aria-label={t("upload.which_column", { name: item.name })}>
      <p class="reason">{t("upload.lacks_columns", { what: missing.map(inWords).join(", ") })}</p>
      <p>{t("upload.say_columns")}</p>
      <ColumnTable
        columns={columns}
        ours={ours}
        had={item.columns}
        action={t("upload.with_columns")}
        use={(named) => {
          item.columns = named;
          void retry(item);
        }}
      />
    </section>
  );
}

/** Lets people say which column of their CSV is which, where it was refused for columns that it lacks. */
import { useEffect, useId, useState } from "preact/hooks";
import { tellError } from "../shared/Messages";
import { methods } from "../shared/methods";
import { t } from "../shared/texts";
import { columnsOf, missingColumns } from "./header";
import { type Item, retry } from "./queue";

/** Whether that may be why an item was refused. */
export function mayLackColumns(item: Item): boolean {
  const problem = item.problem.value;
  return (
    item.files.length === 1 && problem?.status === 422 && (problem.type ?? "").endsWith("/malformed-log")
  );
}

/** The form. */
export function Columns({ item }: { item: Item }) {
  const id = useId();
  const [ours, setOurs] = useState<string[]>([]);
  const [theirs, setTheirs] = useState<string[]>([]);
  const [chosen, setChosen] = useState<Record<string, string>>(item.columns);
  useEffect(() => {
    const [file] = item.files;
    if (!file) return;
    Promise.all([methods(), columnsOf(file)]).then(([known, header]) => {
      setOurs(missingColumns(item.problem.value?.message ?? "", known.columns, header));
      setTheirs(header);
    }, tellError);
  }, [item]);
  if (ours.length === 0 || theirs.length === 0) return null;
  const named = Object.fromEntries(Object.entries(chosen).filter(([, name]) => name !== ""));
  return (
    <form
      class="columns"
      onSubmit={(event) => {
        event.preventDefault();
        item.columns = named;
        void retry(item);
      }}
    >
      <fieldset>
        <legend>{t("upload.which_column")}</legend>
        {ours.map((one) => (
          <div key={one} class="column">
            <label for={`${id}-${one}`}>
              <code>{one}</code>
            </label>
            <select
              id={`${id}-${one}`}
              value={chosen[one] ?? ""}
              onChange={(event) => setChosen({ ...chosen, [one]: event.currentTarget.value })}
            >
              <option value="">{t("upload.not_in_file")}</option>
              {theirs.map((name) => (
                <option key={name} value={name}>
                  {name}
                </option>
              ))}
            </select>
          </div>
        ))}
        <button type="submit" class="primary" disabled={Object.keys(named).length === 0}>
          {t("upload.with_columns")}
        </button>
      </fieldset>
    </form>
  );
}

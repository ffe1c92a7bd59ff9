/** A table of a file's columns, in which people say what each is. */
import { useId, useState } from "preact/hooks";
import { t } from "../shared/texts";
import { type Choice, corrected, inWords, type LogColumn, type Named, takenAs, twice } from "./corrected";
import "./columns.css";

interface Props {
  columns: LogColumn[];
  /** What can be said of columns, by Versant's names. */
  ours: string[];
  /** What was said before. */
  had: Named;
  action: string;
  busy?: boolean;
  use: (named: Named) => void;
}

export function ColumnTable({ columns, ours, had, action, busy = false, use }: Props) {
  const id = useId();
  const [choice, choose] = useState<Choice>({});
  const doubled = twice(columns, choice);
  const unchanged = columns.every((one) => takenAs(one, choice) === (one.taken_as ?? ""));
  return (
    <form
      class="column-table"
      onSubmit={(event) => {
        event.preventDefault();
        use(corrected(columns, choice, ours, had));
      }}
    >
      <table>
        <thead>
          <tr>
            <th scope="col">{t("columns.column")}</th>
            <th scope="col">{t("columns.taken_as")}</th>
            <th scope="col">{t("columns.unit")}</th>
            <th scope="col">{t("columns.values")}</th>
          </tr>
        </thead>
        <tbody>
          {columns.map((one, k) => {
            const as = takenAs(one, choice);
            const isAsBefore = as === (one.taken_as ?? "");
            // Dates and the like are what they are: nothing else can be said of them.
            const isFixed = one.taken_as !== null && !ours.includes(one.taken_as);
            return (
              <tr key={one.name} class={as === "" ? "unused" : ""}>
                <th scope="row" id={`${id}-${k}`}>
                  {one.name}
                </th>
                <td>
                  {isFixed ? (
                    inWords(as)
                  ) : (
                    <select
                      aria-labelledby={`${id}-${k}`}
                      value={as}
                      onChange={(event) => choose({ ...choice, [one.name]: event.currentTarget.value })}
                    >
                      <option value="">{t("columns.not_used")}</option>
                      {ours.map((name) => (
                        <option key={name} value={name}>
                          {inWords(name)}
                        </option>
                      ))}
                    </select>
                  )}
                  {one.guessed && isAsBefore && <small class="quiet-text"> {t("columns.guessed")}</small>}
                </td>
                <td>{isAsBefore ? one.unit : ""}</td>
                <td class="quiet-text">{one.values.join(" · ")}</td>
              </tr>
            );
          })}
        </tbody>
      </table>
      {doubled.length > 0 && (
        <p class="error-text" role="alert">
          {t("columns.twice", { what: doubled.map(inWords).join(", ") })}
        </p>
      )}
      <button type="submit" class="primary" disabled={busy || unchanged || doubled.length > 0}>
        {action}
      </button>
    </form>
  );
}

/** Many drives at once, chosen by a form: computed again or removed, each after a look at what it would do. */
import { useRef, useState } from "preact/hooks";
import { t } from "../../shared/texts";
import { remove, reprocess, type Selection } from "../actions/drives";
import { days, useQuery, useReading } from "../page_state";
import type { Failure, Region } from "../types";

const WHICH = ["failed", "stale", "other", "all"] as const;

/** What a form says, without what is empty; days become their first moment. */
export function selectionOf(entries: Iterable<[string, unknown]>): Selection {
  const chosen: Selection = {};
  for (const [name, value] of entries) {
    const text = String(value).trim();
    if (text !== "") chosen[name] = /^\d{4}-\d\d-\d\d$/.test(text) ? `${text}T00:00:00Z` : text;
  }
  return chosen;
}

export function Bulk() {
  const form = useRef<HTMLFormElement>(null);
  const [message, setMessage] = useState<string | null>(null);
  const [asking, setAsking] = useState(false);
  const failures = useQuery<Failure>("failures", 60, days.value).data.value?.rows ?? [];
  const regions = useReading<{ regions: Region[] }>("/v1/regions", 60).data.value?.regions ?? [];

  const methods =
    useReading<{ methods: { name: string; title: string }[] }>("/v1/methods", 600).data.value?.methods ?? [];

  async function go(action: typeof reprocess) {
    if (!form.current?.reportValidity()) return;
    const selection = selectionOf(new FormData(form.current).entries() as Iterable<[string, unknown]>);
    if (action === remove) delete selection["method"];
    setAsking(true);
    setMessage(null);
    setMessage(await action(selection, t("admin.bulk.whom")));
    setAsking(false);
  }

  return (
    <form ref={form} onSubmit={(event) => event.preventDefault()}>
      <p>{t("admin.bulk.what")}</p>
      <div class="fields">
        <label>
          {t("admin.bulk.which")}
          <select name="which">
            {WHICH.map((one) => (
              <option key={one} value={one}>
                {t(one === "other" ? "admin.bulk.other_method" : `admin.bulk.${one}`)}
              </option>
            ))}
          </select>
        </label>
        <label>
          {t("admin.bulk.failure")}
          <select name="failure">
            <option value="">{t("admin.bulk.any")}</option>
            {failures.map(
              ({ kind }) =>
                kind && (
                  <option key={kind} value={kind}>
                    {kind}
                  </option>
                ),
            )}
          </select>
        </label>
        <label>
          {t("admin.bulk.region")}
          <select name="region">
            <option value="">{t("admin.bulk.any")}</option>
            {regions.map(({ name }) => (
              <option key={name} value={name}>
                {name}
              </option>
            ))}
          </select>
        </label>
        <label>
          {t("admin.bulk.from_method")}
          <select name="from_method">
            <option value="">{t("admin.bulk.any")}</option>
            {methods.map(({ name }) => (
              <option key={name} value={name}>
                {name}
              </option>
            ))}
          </select>
        </label>
        <label>
          {t("admin.bulk.created_after")}
          <input type="date" name="created_after" />
        </label>
        <label>
          {t("admin.bulk.created_before")}
          <input type="date" name="created_before" />
        </label>
        <label>
          {t("admin.bulk.method")}
          <select name="method">
            <option value="">{t("admin.bulk.own_method")}</option>
            {methods.map(({ name, title }) => (
              <option key={name} value={name} title={title}>
                {name}
              </option>
            ))}
          </select>
        </label>
      </div>
      {message && <p role="status">{message}</p>}
      <div class="buttons">
        <button type="button" class="danger" disabled={asking} onClick={() => void go(remove)}>
          {t("admin.bulk.remove")}
        </button>
        <button type="button" class="primary" disabled={asking} onClick={() => void go(reprocess)}>
          {t("admin.bulk.again")}
        </button>
      </div>
    </form>
  );
}

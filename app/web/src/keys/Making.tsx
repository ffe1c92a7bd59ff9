/** Making a key. */
import { useSignal } from "@preact/signals";
import { useId } from "preact/hooks";
import { dayOf, midnight } from "../shared/days";
import { useSending } from "../shared/sending";
import { may, type Scope, session } from "../shared/session";
import { t } from "../shared/texts";
import { makeKey, owners } from "./state";

const SCOPES: readonly Scope[] = ["upload", "own", "operate"];

/** What each scope is for: those that the caller may give. */
function Scopes({ chosen, choose }: { chosen: Scope; choose: (scope: Scope) => void }) {
  const name = useId();
  return (
    <fieldset>
      <legend>{t("keys.scope")}</legend>
      {SCOPES.filter(may).map((one) => (
        <label key={one}>
          <input type="radio" name={name} checked={one === chosen} onChange={() => choose(one)} />
          <span>
            <code>{one}</code>: {t(`keys.scopes.${one}`)}
          </span>
        </label>
      ))}
    </fieldset>
  );
}

function Owners({ chosen, choose }: { chosen: string; choose: (owner: string) => void }) {
  if (owners.value === null) return null;
  return (
    <label>
      <span>{t("keys.owner")}</span>
      <select value={chosen} onChange={(event) => choose(event.currentTarget.value)}>
        {owners.value.map((one) => (
          <option key={one.id} value={one.name}>
            {one.name}
          </option>
        ))}
      </select>
    </label>
  );
}

export function Making() {
  const label = useSignal("");
  const scope = useSignal<Scope>("upload");
  const owner = useSignal(session()?.owner?.name ?? "");
  const until = useSignal("");
  const { busy, submit, failure } = useSending(async () => {
    const expires_at = midnight(until.value, 1);
    await makeKey({
      label: label.value.trim(),
      scope: scope.value,
      ...(owners.value && owner.value ? { owner: owner.value } : {}),
      ...(expires_at ? { expires_at } : {}),
    });
    label.value = "";
  });
  return (
    <form class="card making" aria-labelledby="making" onSubmit={submit}>
      <h2 id="making">{t("keys.make_title")}</h2>
      <label>
        <span>{t("keys.label")}</span>
        <input
          value={label.value}
          required
          maxLength={100}
          placeholder={t("keys.label_example")}
          onInput={(event) => {
            label.value = event.currentTarget.value;
          }}
        />
      </label>
      <Owners
        chosen={owner.value}
        choose={(name) => {
          owner.value = name;
        }}
      />
      <label>
        <span>{t("keys.until")}</span>
        <input
          type="date"
          min={dayOf(new Date().toISOString())}
          value={until.value}
          onChange={(event) => {
            until.value = event.currentTarget.value;
          }}
        />
      </label>
      <Scopes
        chosen={scope.value}
        choose={(one) => {
          scope.value = one;
        }}
      />
      {failure}
      <button type="submit" class="primary" disabled={busy}>
        {t("keys.make")}
      </button>
    </form>
  );
}

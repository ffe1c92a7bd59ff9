/** Choosing a program, and making an address for it. */
import { useSignal } from "@preact/signals";
import { useId } from "preact/hooks";
import { useSending } from "../shared/sending";
import { t } from "../shared/texts";
import { makeAddress, senders } from "./state";

export function Making() {
  const label = useSignal("");
  const chosen = useSignal("");
  const name = useId();
  const sender = senders.value.find((one) => one.name === chosen.value) ?? senders.value[0];
  const { busy, submit, failure } = useSending(async () => {
    if (sender === undefined) return;
    await makeAddress(sender, label.value.trim() || t("phones.label_example"));
    label.value = "";
  });
  return (
    <form class="card making" aria-labelledby="making" onSubmit={submit}>
      <h2 id="making">{t("phones.make_title")}</h2>
      <fieldset>
        <legend>{t("phones.program")}</legend>
        {senders.value.map((one) => (
          <label key={one.name}>
            <input
              type="radio"
              name={name}
              checked={one.name === sender?.name}
              onChange={() => {
                chosen.value = one.name;
              }}
            />
            <span>{one.title}</span>
          </label>
        ))}
      </fieldset>
      <label>
        <span>{t("phones.label")}</span>
        <input
          value={label.value}
          maxLength={100}
          placeholder={t("phones.label_example")}
          onInput={(event) => {
            label.value = event.currentTarget.value;
          }}
        />
      </label>
      {failure}
      <button type="submit" class="primary" disabled={busy || sender === undefined}>
        {t("phones.make")}
      </button>
    </form>
  );
}

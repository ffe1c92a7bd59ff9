/** For how long logs are kept. */
import { useSignal } from "@preact/signals";
import { confirmed } from "../shared/Confirm";
import { tellDone } from "../shared/Messages";
import { useSending } from "../shared/sending";
import { t } from "../shared/texts";
import { type Choice, choiceOf, daysOf, isShorter } from "./keeping";
import { type Figures, saveKeeping } from "./state";

const CHOICES: readonly Choice[] = ["as_all", "done", "days"];
const MOST_DAYS = 36_500;

function holds(days: number | null): string {
  if (days === null) return t("owner.holds.good");
  return days === 0 ? t("owner.holds.done") : t("owner.holds.days", { n: days });
}

export function Keeping({ of: owner }: { of: Figures }) {
  const choice = useSignal(choiceOf(owner.keep_logs_days));
  const days = useSignal(String(owner.keep_logs_days || 30));
  const wanted = daysOf(choice.value, days.value);
  const save = async () => {
    await saveKeeping(wanted);
    tellDone(t("owner.saved"));
  };
  const agreed = async () =>
    !isShorter(wanted, owner.logs_kept_days) ||
    confirmed({
      title: t("owner.keep_title"),
      what: <p>{t("owner.keep_sure")}</p>,
      action: t("owner.save"),
      destructive: true,
    });
  const { busy, submit, failure } = useSending(save, agreed);
  return (
    <form class="card keeping" aria-labelledby="keeping" onSubmit={submit}>
      <h2 id="keeping">{t("owner.keeping")}</h2>
      <p>{t("owner.keeping_what")}</p>
      <fieldset>
        <legend>{holds(owner.logs_kept_days)}</legend>
        {CHOICES.map((one) => (
          <label key={one}>
            <input
              type="radio"
              name="keeping"
              checked={one === choice.value}
              onChange={() => {
                choice.value = one;
              }}
            />
            <span>{t(`owner.keep.${one}`)}</span>
          </label>
        ))}
      </fieldset>
      {choice.value === "days" && (
        <label class="field">
          <span>{t("owner.days")}</span>
          <input
            type="number"
            required
            min={1}
            max={MOST_DAYS}
            step={1}
            value={days.value}
            onInput={(event) => {
              days.value = event.currentTarget.value;
            }}
          />
        </label>
      )}
      {failure}
      <button type="submit" class="primary" disabled={busy}>
        {t("owner.save")}
      </button>
    </form>
  );
}

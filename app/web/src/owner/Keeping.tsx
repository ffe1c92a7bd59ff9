/** For how long logs are kept. */
import { useSignal } from "@preact/signals";
import { confirmed } from "../shared/Confirm";
import { errorText, tellDone } from "../shared/Messages";
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
  const busy = useSignal(false);
  const why = useSignal<string | null>(null);
  const save = async () => {
    const wanted = daysOf(choice.value, days.value);
    const question = {
      title: t("owner.keep_title"),
      what: <p>{t("owner.keep_sure")}</p>,
      action: t("owner.save"),
      destructive: true,
    };
    if (isShorter(wanted, owner.logs_kept_days) && !(await confirmed(question))) return;
    busy.value = true;
    why.value = null;
    try {
      await saveKeeping(wanted);
      tellDone(t("owner.saved"));
    } catch (error) {
      why.value = errorText(error);
    }
    busy.value = false;
  };
  return (
    <form
      class="card keeping"
      aria-labelledby="keeping"
      onSubmit={(event) => {
        event.preventDefault();
        void save();
      }}
    >
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
      <p class="error-text" role="alert">
        {why.value}
      </p>
      <button type="submit" class="primary" disabled={busy.value}>
        {t("owner.save")}
      </button>
    </form>
  );
}

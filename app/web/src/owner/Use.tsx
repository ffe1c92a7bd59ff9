/** What there is of the owner, and how much of its quotas is used today. */
import { moment, number, size } from "../shared/format";
import { t } from "../shared/texts";
import type { Figures } from "./state";

function used(amount: number, most: number | null, as: (value: number) => string): string {
  const said = as(amount);
  return most === null
    ? t("owner.no_quota", { used: said })
    : t("owner.of_quota", { used: said, most: as(most) });
}

const KINDS = [
  ["drives", number],
  ["bytes", size],
  ["records", number],
] as const;

export function Use({ of: { today, ...owner } }: { of: Figures }) {
  const facts = [
    [t("owner.drives"), number(owner.drives)],
    [t("owner.logs"), size(owner.bytes)],
    [t("owner.keys"), number(owner.keys)],
    [t("owner.since"), moment(owner.created_at)],
    ...KINDS.map(([kind, as]) => [t(`owner.today.${kind}`), used(today[kind], today[`quota_${kind}`], as)]),
  ];
  return (
    <section class="card" aria-labelledby="has">
      <h2 id="has">{t("owner.has")}</h2>
      <dl class="facts">
        {facts.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {KINDS.some(([kind]) => today[`quota_${kind}`] !== null) && (
        <p class="quiet-text">{t("owner.until", { when: moment(today.until) })}</p>
      )}
    </section>
  );
}

/** Fields of a form made of a JSON Schema: one for each property, with its range, its default and what it means. */
import { useId } from "preact/hooks";
import { t } from "./texts";

export interface Property {
  type?: string;
  anyOf?: Property[];
  enum?: (string | number)[];
  const?: string | number;
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  exclusiveMaximum?: number;
  default?: unknown;
  description?: string;
}
export interface Schema {
  properties?: Record<string, Property>;
}
/** What differs from the defaults. */
export type Chosen = Record<string, unknown>;

interface FieldsProps {
  schema: Schema;
  chosen: Chosen;
  choose: (chosen: Chosen) => void;
}

/** The property itself where it may also be null. */
function bare(property: Property): Property {
  const own = property.anyOf?.find((one) => one.type !== "null");
  return own ? { ...property, ...own } : property;
}

/** The range in signs: "> 0, ≤ 10". */
export function range(property: Property): string {
  const { minimum, maximum, exclusiveMinimum, exclusiveMaximum } = bare(property);
  const bounds: [string, number | undefined][] = [
    ["≥", minimum],
    [">", exclusiveMinimum],
    ["≤", maximum],
    ["<", exclusiveMaximum],
  ];
  return bounds.flatMap(([sign, bound]) => (bound === undefined ? [] : [`${sign} ${bound}`])).join(", ");
}

/** Whether the property may have the value. */
export function allowed(property: Property, value: unknown): boolean {
  const own = bare(property);
  if (own.type !== "number" && own.type !== "integer") return true;
  if (typeof value !== "number" || !Number.isFinite(value)) return false;
  return (
    (own.type !== "integer" || Number.isInteger(value)) &&
    value >= (own.minimum ?? -Infinity) &&
    value <= (own.maximum ?? Infinity) &&
    value > (own.exclusiveMinimum ?? -Infinity) &&
    value < (own.exclusiveMaximum ?? Infinity)
  );
}

function shown(value: unknown): string {
  if (value === null || value === undefined) return t("upload.none");
  if (typeof value === "boolean") return t(value ? "upload.yes" : "upload.no");
  return String(value);
}

interface FieldProps {
  name: string;
  property: Property;
  value: unknown;
  /** `undefined` is the default. */
  change: (value: unknown) => void;
}

function Field({ name, property, value, change }: FieldProps) {
  const id = useId();
  const own = bare(property);
  const numeric = own.type === "number" || own.type === "integer";
  const names = own.enum ?? (own.const === undefined ? undefined : [own.const]);
  const choices = names ?? (own.type === "boolean" ? [true, false] : undefined);
  const usual = t("upload.usual", { value: shown(property.default) });
  const wrong = value !== undefined && !allowed(property, value);
  const help = `${id}-help`;
  return (
    <div class="field">
      <label for={id}>
        <code>{name}</code>
      </label>
      {choices ? (
        <select
          id={id}
          aria-describedby={help}
          value={value === undefined ? "" : String(value)}
          onChange={(event) => {
            const index = event.currentTarget.selectedIndex - 1;
            change(index < 0 ? undefined : choices[index]);
          }}
        >
          <option value="">{usual}</option>
          {choices.map((one) => (
            <option key={String(one)} value={String(one)}>
              {shown(one)}
            </option>
          ))}
        </select>
      ) : (
        <input
          id={id}
          aria-describedby={help}
          aria-invalid={wrong}
          type={(numeric ? "number" : "text") as "number"}
          step={own.type === "integer" ? 1 : "any"}
          min={own.minimum ?? own.exclusiveMinimum}
          max={own.maximum ?? own.exclusiveMaximum}
          placeholder={usual}
          value={value === undefined ? "" : String(value)}
          onInput={(event) => {
            const text = event.currentTarget.value;
            change(text === "" ? undefined : numeric ? Number(text) : text);
          }}
        />
      )}
      <small id={help} class={wrong ? "error-text" : "quiet-text"}>
        {wrong ? t("upload.out_of_range", { range: range(property) }) : property.description}{" "}
        {!wrong && range(property) ? `(${range(property)})` : ""}
      </small>
    </div>
  );
}

/** The fields. */
export function SchemaFields({ schema, chosen, choose }: FieldsProps) {
  const change = (name: string, value: unknown) => {
    const { [name]: _, ...others } = chosen;
    choose(value === undefined ? others : { ...others, [name]: value });
  };
  return (
    <div class="fields">
      {Object.entries(schema.properties ?? {}).map(([name, property]) => (
        <Field
          key={name}
          name={name}
          property={property}
          value={chosen[name]}
          change={(value) => change(name, value)}
        />
      ))}
    </div>
  );
}

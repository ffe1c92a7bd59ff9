/** What a value is made of: a list that opens level by level, since schemas may hold themselves. */
import { useState } from "preact/hooks";
import { t } from "../shared/texts";
import { type ApiDocument, boundsOf, meaningOf, type Schema, typeOf } from "./openapi";
import { Prose } from "./Prose";

interface SchemaProps {
  schema: Schema;
  document: ApiDocument;
}

/** Type, bounds, default and choices of a value, in a line; what is `sent` in an address cannot be null. */
export function Facts({ schema, document, sent = false }: SchemaProps & { sent?: boolean }) {
  const { schema: at } = meaningOf(schema, document);
  const choices = at.enum ?? (at.const === undefined ? [] : [at.const]);
  return (
    <span class="facts">
      <code>{sent ? typeOf(schema, document).replace(/ \| null$/, "") : typeOf(schema, document)}</code>{" "}
      {boundsOf(at).join(", ")}
      {at.minItems !== undefined && at.maxItems !== undefined && (
        <> {t("docs.items", { least: at.minItems, most: at.maxItems })}</>
      )}
      {at.maxLength !== undefined && <> {t("docs.characters", { most: at.maxLength })}</>}
      {at.default !== undefined && at.default !== null && (
        <>
          {" "}
          {t("docs.default")} <code>{JSON.stringify(at.default)}</code>
        </>
      )}
      {choices.length > 0 && (
        <>
          {" "}
          {t("docs.one_of")}{" "}
          {choices.map((one) => (
            <>
              <code>{String(one)}</code>{" "}
            </>
          ))}
        </>
      )}
    </span>
  );
}

/** What can be opened below a schema. */
function inside(schema: Schema, document: ApiDocument): Schema | null {
  const { schema: at } = meaningOf(schema, document);
  if (at.properties) return at;
  if (at.items) return inside(at.items, document);
  if (typeof at.additionalProperties === "object") return inside(at.additionalProperties, document);
  return null;
}

function Property({ name, schema, needed, document }: SchemaProps & { name: string; needed: boolean }) {
  const [open, setOpen] = useState(false);
  const deeper = [schema, ...meaningOf(schema, document).alternatives].find((one) => inside(one, document));
  return (
    <li>
      <code class="name">{name}</code> {needed && <strong>{t("docs.required")}</strong>}{" "}
      <Facts schema={schema} document={document} />
      <Prose text={meaningOf(schema, document).schema.description} />
      {deeper && (
        <details onToggle={(event) => setOpen(event.currentTarget.open)}>
          <summary>{t("docs.parts_of", { name })}</summary>
          {open && <Properties schema={deeper} document={document} />}
        </details>
      )}
    </li>
  );
}

/** The parts of an object, or of the objects in a list. */
export function Properties({ schema, document }: SchemaProps) {
  const at = inside(schema, document);
  if (!at?.properties) return null;
  return (
    <ul class="properties">
      {Object.entries(at.properties).map(([name, one]) => (
        <Property
          key={name}
          name={name}
          schema={one}
          needed={at.required?.includes(name) ?? false}
          document={document}
        />
      ))}
    </ul>
  );
}

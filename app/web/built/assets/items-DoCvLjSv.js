var e=`<h1 id="items-what-can-be-asked-and-what-it-costs">Items: what can be asked, and what it costs</h1>
<p><code>/collections/segments/items</code> and <code>/collections/ways/items</code> are answered by one engine, <code>app/map/items/</code>: <code>collections.py</code> says what there is, <code>request.py</code> reads parameters, <code>filters.py</code> turns CQL2 into a condition, <code>paging.py</code> knows the order and where a page begins, <code>geojson.py</code> lets PostgreSQL write the
features, <code>store.py</code> puts the statement together. What somebody sent is only ever a parameter of a statement; names become expressions of <code>collections.py</code>.</p>
<h2 id="filters"><a class="self" href="#filters">Filters</a></h2>
<p><code>filter=</code> in CQL2, <code>filter-lang=cql2-text</code> (default) or <code>cql2-json</code>, <code>filter-crs=</code> for its geometries. The grammar is read by the library <code>cql2</code>; what comes out is compiled here, so every property, function and type is checked: a mistake is a 400 that says where it stands (character of a text, way into JSON) and what there is.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th></th>
<th></th>
</tr>
</thead>
<tbody>
<tr>
<td>comparison</td>
<td><code>=</code> <code>&lt;&gt;</code> <code>&lt;</code> <code>&lt;=</code> <code>&gt;</code> <code>&gt;=</code>, <code>BETWEEN</code>, <code>IN</code>, <code>LIKE</code> (<code>%</code>, <code>_</code>, backslash), <code>IS NULL</code>, each with <code>NOT</code></td>
</tr>
<tr>
<td>logic</td>
<td><code>AND</code> before <code>OR</code>; what is unknown makes neither true nor false, as in SQL: <code>NOT (slope_percent &gt; 5)</code> leaves out roads without a slope</td>
</tr>
<tr>
<td>texts</td>
<td><code>CASEI</code> (letters of all scripts), <code>ACCENTI</code>; compared byte by byte otherwise</td>
</tr>
<tr>
<td>numbers</td>
<td><code>+ - * / % div ^</code>; a division by 0 is unknown; what overflows is a 400. Filters compare what is stored, which has more digits than what is shown. Whole numbers beyond 2^53 only in JSON, where they are exact</td>
</tr>
<tr>
<td>times</td>
<td><code>TIMESTAMP</code>, <code>DATE</code>, <code>INTERVAL</code>, and the <code>T_</code> functions. In comparisons a date is its first moment in UTC, in <code>T_</code> functions the whole day; a time that is written to the millisecond means that millisecond there</td>
</tr>
<tr>
<td>places</td>
<td><code>S_INTERSECTS</code> <code>S_DISJOINT</code> <code>S_WITHIN</code> <code>S_CONTAINS</code> <code>S_CROSSES</code> <code>S_TOUCHES</code> <code>S_OVERLAPS</code> <code>S_EQUALS</code> on <code>geometry</code>; points, lines, polygons, several of one kind, <code>BBOX</code> (across the antimeridian too)</td>
</tr>
</tbody>
</table></div>
<p>Limits, each told with a 400: 64,000 characters, operators and brackets 32 deep, 250 operators (2,000 parts in JSON), lists of 1,000, geometries of 5,000 points, 200,000 characters of SQL. They are checked before the library sees the text: its parser calls itself for each bracket and sign, and a deep text would end the process; and what stands in n brackets it may read 2^n times, so a text may come to 400,000 characters counted that way (JSON is read once). Each operand becomes SQL once, so that a statement grows as its filter does. All statements of a page, planned and executed, together have <code>VERSANT_ITEMS_TIMEOUT_S</code>; those of filters are not prepared, since a connection would keep them. It does not read <code>.5</code>: write <code>0.5</code>.</p>
<h2 id="order-and-pages"><a class="self" href="#order-and-pages">Order and pages</a></h2>
<p>Without <code>sortby</code> items come by ascending id. With it, up to four properties decide, then the id, in the direction of the last of them; what is unknown comes last in either direction. <code>after</code> in a <code>next</code> link holds the values of the last item before the page, so a page far behind costs what the first does, nothing is kept on the
server, and a link works for as long as its query makes sense. It belongs to its query: with other filters or another order it is refused; <code>limit</code>, <code>crs</code>, <code>properties</code> and <code>skipGeometry</code> may change on the way. A plain number is the last id where items come by id. Each item that does not change meanwhile is reached once; what changes
its place may be met twice or not at all.</p>
<p><code>updated_since</code> takes a time or the <code>version</code> of an earlier answer. A listing of changes ends where its first page began, however many pages it has, and each of them names the version to go on from.</p>
<p><code>numberMatched</code> is exact where it is told: where the first page holds everything, or up to 10,000 items when the planner expects that to cost a few milliseconds.</p>
<h2 id="what-it-costs"><a class="self" href="#what-it-costs">What it costs</a></h2>
<p>A page in a box, by id, by class or name of the road, by way, by slope, steepest stretch or last change goes by an index. Everything else looks at rows in the order asked for until the page is full, at worst at all of them: of a million segments half a second, ended after <code>VERSANT_ITEMS_TIMEOUT_S</code> by a 400 that says what is
quick. Where a page is known by <code>segments</code> alone, slopes are looked up for its own features only; the planner, left alone, reads all slopes for a thousand features.</p>
<p>PostgreSQL writes a feature by one <code>concat</code>, in two forms: what was never driven has constants for all that it lacks. Numbers are rounded by the same three steps of arithmetic in <code>app.core.text.rounded</code>, numpy and SQL, so that no output differs in a last digit; <code>tests/app/map/items/test_geojson_text.py</code> holds them together.</p>
`;export{e as default};
var e=`<h1 id="exports">Exports</h1>
<p>The stored map, or a part of it, as a file: <code>versant export</code> writes it where you are, <code>/v1/exports</code> has a worker write it and keeps it for some days. Both take the same formats, filters and options, and the same state of the data makes the same bytes by either.</p>
<pre tabindex="0"><code>versant export -o slopes.fgb --region karlsruhe                      # the suffix chooses the format ...
versant export -o ways.csv --as ways-csv --driven                    # ... or its name, where several have the suffix
versant export -o slopes.pmtiles --option max_zoom=12                # options belong to a format
curl -i -X POST http://127.0.0.1:8000/v1/exports -H 'Content-Type: application/json' \\
     -d '{&quot;format&quot;: &quot;flatgeobuf&quot;, &quot;bbox&quot;: [8.46, 48.95, 8.50, 48.99], &quot;driven&quot;: true}'
</code></pre>
<p>README lists the formats (<code>app/exports/formats.py</code> is their registry); <code>GET /v1/exports/formats</code> does so with the JSON schema of each one's options. Those that name a file of the machine are for <code>versant export</code> alone. <code>bbox</code> is for all; <code>driven</code>, <code>gaps</code> and <code>region</code> only where a format says so.</p>
<h2 id="what-a-file-holds"><a class="self" href="#what-a-file-holds">What a file holds</a></h2>
<p><strong>One moment.</strong> A file is read in one snapshot of the database: a drive that ends meanwhile is in it altogether or not at all.</p>
<p><strong>Where it comes from.</strong> <code>provenance</code> says: the version of the data and when they last changed, what was asked for, whose data they are and under which licence (roads, and all that derives from them: OpenStreetMap's, ODbL 1.0), each region of roads with the SHA-256 of its file and when it was imported, the elevation rasters under what is shown with
theirs, what heights refer to, and the version of the program. It stands</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>in</th>
<th>as</th>
</tr>
</thead>
<tbody>
<tr>
<td>GeoJSON</td>
<td>the members <code>attribution</code>, <code>height_datum</code>, <code>changed_at</code>, <code>provenance</code></td>
</tr>
<tr>
<td>GeoParquet</td>
<td>keys of the file's metadata by these names</td>
</tr>
<tr>
<td>GeoPackage, FlatGeobuf</td>
<td>metadata of the layer; the attribution is its description</td>
</tr>
<tr>
<td>PMTiles</td>
<td>its JSON metadata, which are TileJSON's else</td>
</tr>
<tr>
<td>CSV</td>
<td><code>NAME.csv-metadata.json</code> beside it (W3C, CSV on the Web)</td>
</tr>
<tr>
<td>files for other programs</td>
<td><code>NAME.provenance.json</code> beside it, and wherever their form has a place for the attribution</td>
</tr>
</tbody>
</table></div>
<p>What stands beside a file is written by <code>versant export</code>, and linked from an export (<code>rel</code> <code>related</code>, <code>/v1/exports/{id}/beside/{name}</code>). An export's own document holds the provenance as well.</p>
<p><strong>The same again.</strong> Nothing in a file depends on a clock: times in it are those of the data (<code>changed_at</code>), also where a format wants to know when it was written (GeoPackage). Tiles and directories of PMTiles are packed without a time, segments come by their number, those of FlatGeobuf along its curve. So a file of one version of the data, by one
version of the program and of its libraries, is the same byte for byte, whenever it is made, and also from a restored copy of the database (a test holds that for every format). <code>data_version</code> tells versions apart: it is equal for equal data.</p>
<p><strong>Ways</strong> are derived from segments by workers, moments after these changed; a file of ways, and the low zooms of tiles, may be that much older than one of segments. <code>data_version</code> counts both.</p>
<p><strong>Tiles</strong> are those of the service, with its segments from zoom 13 on. A tile's grid is 0.6 m wide at zoom 14: a segment that is shorter is in no tile (10 of Heidelberg's 141,793), and in all other formats.</p>
<p><strong>A map that is kept.</strong> <code>/map?export=ID</code> shows an export of the format <code>pmtiles</code> in place of today's map, for as long as it is there: what was known then, beside what is known now. The map page lists them under &quot;Map of&quot;. Ways are not in them, and what a click tells is of today.</p>
<h2 id="an-exports-life"><a class="self" href="#an-exports-life">An export's life</a></h2>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>status</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>queued</code></td>
<td>It waits. The same request again, while the data are the same, is this export</td>
</tr>
<tr>
<td><code>running</code></td>
<td><code>data_version</code> says of which state it is made, <code>progress</code> how far it is</td>
</tr>
<tr>
<td><code>done</code></td>
<td><code>/v1/exports/{id}/file</code> has it until <code>expires_at</code> (<code>VERSANT_EXPORT_KEEP_DAYS</code>)</td>
</tr>
<tr>
<td><code>failed</code></td>
<td><code>failure</code> says why: no room (<code>storage-full</code>), larger than all may be together (<code>too-large</code>), something that a format needs is not there ... Asking again tries again</td>
</tr>
<tr>
<td><code>cancelled</code></td>
<td>It was deleted. Whoever made it has stopped, its file is gone</td>
</tr>
</tbody>
</table></div>
<p>The file comes whole or in parts: <code>Range</code>, with <code>If-Range</code> and the ETag, which is its SHA-256, goes on where a download broke off (<code>curl -C -</code>, <code>wget -c</code>). <code>Repr-Digest</code> (RFC 9530) is that of the whole file. It is never compressed on the way. A file that is not done is a 409 with <code>Retry-After</code>.</p>
<pre tabindex="0"><code>url=$(curl -s -D - -o /dev/null -X POST $api/v1/exports -H 'Content-Type: application/json' -d '{&quot;format&quot;: &quot;gpkg&quot;}' | sed -n 's/^[Ll]ocation: //p' | tr -d '\\r')
until curl -sf -o slopes.gpkg -C - &quot;$url/file&quot;; do sleep 5; done
</code></pre>
<h2 id="for-operators"><a class="self" href="#for-operators">For operators</a></h2>
<p>Exports stand behind uploads in the queue and before drives that are computed again by the thousand. One is made at a time, however many wait and however many workers there are, so all lanes but one are left to drives; where there is only one lane, or all are taken, an export that finds a drive waiting for two seconds goes back into the
queue, three times at most, and then runs to its end. A worker stands back behind whoever is answered. At most 100 exports wait; one more is answered by 503.</p>
<p>A file is made in <code>VERSANT_DATA_DIR/exports</code> and then goes to where logs are kept, below <code>exports/</code> (a folder or a bucket). Less than <code>VERSANT_MIN_FREE_BYTES</code> of free room in either fails it. A worker that is killed leaves its folder, which workers remove after two <code>VERSANT_RUN_LIMIT_S</code>, and perhaps a file that no export refers to, which they (and <code>versant sweep</code>)
remove after six hours. All exports together take at most <code>VERSANT_EXPORTS_MAX_BYTES</code>; the oldest go first. Backups leave exports out: whoever asks again gets the same file.</p>
<p>Memory stays bounded however large the map is: a page of 5,000 segments, ten thousand rows of a table (fifty thousand of GeoParquet); FlatGeobuf's index takes some 100 bytes a segment inside GDAL, PMTiles some 200 bytes a tile.</p>
`;export{e as default};
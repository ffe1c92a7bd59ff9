var e=`<h1 id="files-for-other-programs">Files for other programs</h1>
<p>Routers, planners and editors read slopes and heights in forms of their own. Versant writes each form exactly as its consumer's source or schema has it: <code>versant export --as NAME -o FILE --option KEY=VALUE</code>, or <code>POST /v1/exports</code> with the same names (options that name a file of your machine are for the
command alone). One consumer's form is one file in <code>app/map/handover/</code>, which states the grammar; a checker of that grammar in <code>tests/app/map/handover/</code> knows nothing of the writer. The same map and options give the same bytes. Roads and their tags come from the files that imports keep of each region, so a region
that an older version imported has to be imported once more.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>name</th>
<th>for</th>
<th>suffixes</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>osm-ele</code></td>
<td>openrouteservice, OpenTripPlanner, SUMO (node tag ele)</td>
<td><code>.osm.pbf</code> <code>.osm</code> <code>.osm.gz</code></td>
<td>OpenStreetMap file with the height of the road, ele, on every node of a road</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td>OSRM (--segment-speed-file, as of src/updater/csv_source.cpp)</td>
<td><code>.csv</code></td>
<td>Speeds of a vehicle on every segment and in each direction, from its slope</td>
</tr>
<tr>
<td><code>routee-grades</code></td>
<td>RouteE Compass (grade_table_input_file)</td>
<td><code>.zip</code> <code>.txt.gz</code></td>
<td>Grade of each edge in the order of the edges: of a network of its own, or of yours</td>
</tr>
<tr>
<td><code>opensidewalks</code></td>
<td>OpenSidewalks schema 0.3</td>
<td><code>.geojson</code></td>
<td>Roads as edges of a walking network with their incline, and the nodes between them</td>
</tr>
<tr>
<td><code>maproulette</code></td>
<td>MapRoulette (line-by-line GeoJSON, cooperative tag fixes)</td>
<td><code>.geojsonl</code> <code>.geojson</code></td>
<td>Proposals of incline=* for people to review, never an edit: a MapRoulette challenge</td>
</tr>
<tr>
<td><code>josm</code></td>
<td>JOSM (OSM XML with upload=never)</td>
<td><code>.osm</code></td>
<td>Proposals of incline=* for people to review, never an edit: ways split where it is steep</td>
</tr>
</tbody>
</table></div>
<h2 id="what-to-set-in-the-consumer"><a class="self" href="#what-to-set-in-the-consumer">What to set in the consumer</a></h2>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>consumer</th>
<th>write</th>
<th>set there</th>
</tr>
</thead>
<tbody>
<tr>
<td>openrouteservice</td>
<td><code>--as osm-ele -o roads.osm.pbf</code></td>
<td><code>source_file</code> of the profile, and <code>preprocessed: true</code> under <code>elevation</code>. It reads a node without <code>ele</code> as 0 m: there is none on a road in this file</td>
</tr>
<tr>
<td>OpenTripPlanner</td>
<td><code>--as osm-ele -o city.osm.pbf --option osm=city-original.osm.pbf</code></td>
<td>the file in the graph's folder in place of the original. It takes <code>ele</code> where tags of bridges, tunnels, embankments and cuttings make it leave its elevation model</td>
</tr>
<tr>
<td>SUMO</td>
<td><code>--as osm-ele -o roads.osm</code> (XML: it reads no PBF)</td>
<td><code>netconvert --osm-files roads.osm --osm.elevation -o net.xml</code>. Where it cannot load its &quot;built in type map&quot; (Debian without <code>sumo-tools</code>), name types yourself: <code>--type-files types.xml</code> with lines such as <code>&lt;type id=&quot;highway.residential&quot; numLanes=&quot;1&quot; speed=&quot;13.9&quot;/&gt;</code></td>
</tr>
<tr>
<td>OSRM</td>
<td><code>--as osrm-speeds -o speeds.csv --option vehicle=truck</code></td>
<td><code>osrm-customize map.osrm --segment-speed-file speeds.csv</code> (MLD), or the same option of <code>osrm-contract</code> (CH). Made from the same OSM data, since nodes are its key</td>
</tr>
<tr>
<td>RouteE Compass</td>
<td><code>--as routee-grades -o network.zip</code>; or for a network of yours <code>-o edges-grade-enumerated.txt.gz --option edges=edges-compass.csv.gz --option vertices=vertices-mapping.csv.gz</code></td>
<td><code>grade_table_input_file = &quot;edges-grade-enumerated.txt.gz&quot;</code>, <code>grade_table_grade_unit = &quot;decimal&quot;</code> (the option <code>unit</code>). The archive's <code>README.txt</code> says the rest</td>
</tr>
<tr>
<td>OpenSidewalks</td>
<td><code>--as opensidewalks -o roads.geojson</code></td>
<td>nothing: schema 0.3, <code>_id</code>, <code>_u_id</code>, <code>_v_id</code>, <code>incline</code></td>
</tr>
<tr>
<td>MapRoulette</td>
<td><code>--as maproulette -o tasks.geojsonl</code>, and <code>--option kind=split</code> for a second challenge</td>
<td>Create Challenge, &quot;local file&quot;, <code>tasks.geojsonl</code>. <code>{{instruction}}</code> in the instructions shows what was measured</td>
</tr>
<tr>
<td>JOSM</td>
<td><code>--as josm -o review.osm</code></td>
<td>open it beside a layer with the present data. It cannot be uploaded</td>
</tr>
</tbody>
</table></div>
<h2 id="options"><a class="self" href="#options">Options</a></h2>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>name</th>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>osm-ele</code></td>
<td><code>osm</code></td>
<td></td>
<td></td>
<td>A file of your own, all of which is kept; else the roads of all regions.</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td><code>vehicle</code></td>
<td><code>car</code></td>
<td></td>
<td>Whose speeds: car, truck, bicycle or e-bike.</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td><code>mass_kg</code></td>
<td></td>
<td>&gt; 0, ≤ 200000</td>
<td>Instead of the vehicle's usual mass.</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td><code>power_kw</code></td>
<td></td>
<td>&gt; 0, ≤ 2000</td>
<td>At the wheel, instead of the usual.</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td><code>drag_area_m2</code></td>
<td></td>
<td>≥ 0, ≤ 20</td>
<td>Drag coefficient times frontal area.</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td><code>rolling</code></td>
<td></td>
<td>≥ 0, ≤ 0.2</td>
<td>Coefficient of rolling resistance.</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td><code>max_kmh</code></td>
<td></td>
<td>&gt; 0, ≤ 200</td>
<td>An upper bound on all roads.</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td><code>unmeasured</code></td>
<td><code>dem</code></td>
<td></td>
<td>Of segments without a measured slope: by the elevation model, as if level, or left out.</td>
</tr>
<tr>
<td><code>osrm-speeds</code></td>
<td><code>decimals</code></td>
<td><code>0</code></td>
<td>≥ 0, ≤ 2</td>
<td>Digits of a speed; old versions of OSRM read whole km/h.</td>
</tr>
<tr>
<td><code>routee-grades</code></td>
<td><code>unit</code></td>
<td><code>decimal</code></td>
<td></td>
<td>decimal, percent or millis.</td>
</tr>
<tr>
<td><code>routee-grades</code></td>
<td><code>edges</code></td>
<td></td>
<td></td>
<td>Your edges-compass.csv.gz, for a .txt.gz alone.</td>
</tr>
<tr>
<td><code>routee-grades</code></td>
<td><code>vertices</code></td>
<td></td>
<td></td>
<td>Your vertices-mapping.csv.gz, which goes with it.</td>
</tr>
<tr>
<td><code>opensidewalks</code></td>
<td><code>incline</code></td>
<td><code>steepest</code></td>
<td></td>
<td>steepest: of the steepest 20 m; mean: of the edge.</td>
</tr>
<tr>
<td><code>opensidewalks</code></td>
<td><code>measured</code></td>
<td><code>false</code></td>
<td>true, false</td>
<td>Only edges whose slope was measured.</td>
</tr>
<tr>
<td><code>maproulette</code></td>
<td><code>min_percent</code></td>
<td><code>5</code></td>
<td>≥ 1, ≤ 50</td>
<td>How steep every part of a section is at least.</td>
</tr>
<tr>
<td><code>maproulette</code></td>
<td><code>z</code></td>
<td><code>3</code></td>
<td>≥ 1, ≤ 100</td>
<td>Its mean slope is so many times its sigma, at least.</td>
</tr>
<tr>
<td><code>maproulette</code></td>
<td><code>min_drives</code></td>
<td><code>2</code></td>
<td>≥ 1</td>
<td>So many drives measured each of its segments, at least.</td>
</tr>
<tr>
<td><code>maproulette</code></td>
<td><code>min_length_m</code></td>
<td><code>30</code></td>
<td>≥ 5</td>
<td>How long a section is at least.</td>
</tr>
<tr>
<td><code>maproulette</code></td>
<td><code>conflict_percent</code></td>
<td><code>3</code></td>
<td>≥ 0</td>
<td>A tag that differs by more is in conflict with what was measured.</td>
</tr>
<tr>
<td><code>maproulette</code></td>
<td><code>only</code></td>
<td><code>both</code></td>
<td></td>
<td>untagged, conflict or both.</td>
</tr>
<tr>
<td><code>maproulette</code></td>
<td><code>kind</code></td>
<td><code>tags</code></td>
<td></td>
<td>tags: whole ways, as tag fixes; split: parts of ways.</td>
</tr>
<tr>
<td><code>josm</code></td>
<td><code>min_percent</code></td>
<td><code>5</code></td>
<td>≥ 1, ≤ 50</td>
<td>How steep every part of a section is at least.</td>
</tr>
<tr>
<td><code>josm</code></td>
<td><code>z</code></td>
<td><code>3</code></td>
<td>≥ 1, ≤ 100</td>
<td>Its mean slope is so many times its sigma, at least.</td>
</tr>
<tr>
<td><code>josm</code></td>
<td><code>min_drives</code></td>
<td><code>2</code></td>
<td>≥ 1</td>
<td>So many drives measured each of its segments, at least.</td>
</tr>
<tr>
<td><code>josm</code></td>
<td><code>min_length_m</code></td>
<td><code>30</code></td>
<td>≥ 5</td>
<td>How long a section is at least.</td>
</tr>
<tr>
<td><code>josm</code></td>
<td><code>conflict_percent</code></td>
<td><code>3</code></td>
<td>≥ 0</td>
<td>A tag that differs by more is in conflict with what was measured.</td>
</tr>
<tr>
<td><code>josm</code></td>
<td><code>only</code></td>
<td><code>both</code></td>
<td></td>
<td>untagged, conflict or both.</td>
</tr>
</tbody>
</table></div>
<h2 id="heights-without-a-gap-osm-ele"><a class="self" href="#heights-without-a-gap-osm-ele">Heights without a gap: <code>osm-ele</code></a></h2>
<p>Every node of every way with a <code>highway</code> (and of ferries, platforms and piers of a file of your own) has <code>ele</code>, metres with two digits, whichever class it is: a router that meets a node without one takes 0 m or falls back on its own model in the middle of a street.</p>
<ul>
<li><strong>Measured nodes have what was measured</strong>: the height of the network's node, which all segments there share; several statements are averaged by their weights.</li>
<li><strong>Elsewhere the elevation model's shape, shifted.</strong> Receivers' heights and a model's differ by their datums, by metres of the model's errors, and wherever a road is not on the ground. Put side by side they would be a wall at the end of every measured street. So a correction is laid on the model's heights: exactly
the difference where a node was measured; along the roads away from there it fades into the usual difference of the area (the median per square degree) within about 500 m. It is the solution of one sparse system for all nodes (<code>fusion/roads/node_heights.py</code>), so loops and junctions agree, and it lies between the
corrections around it: nothing overshoots. Where a slope was measured but no height, as slope-only methods do, the road rises by it.</li>
<li><strong>Bridges and tunnels</strong> go on from beyond their ends in proportion to the lengths, whatever lies below or above: within 30 m of an end, about a post of the usual models, the model's ground is the valley's side or the hill's, and would make a wall of the approach. In three simulated towns the model is off by 3.8, 7.3 and
4.3 m at the ends of bridges and tunnels, and this by 1.6, 2.5 and 3.2 m. Ends and piers that were measured are kept.</li>
<li><strong>Voids</strong> of the model are spanned in the same way. A road that is connected to nothing known has the height of the nearest place that is known; how many there are is told.</li>
<li><strong>One datum</strong>, stated in the header's generator: the one place that both OSM XML and PBF have. Of the network where anything was measured, else of the elevation model. An <code>ele</code> that a node of a road had is replaced, and counted.</li>
</ul>
<p>With <code>osm=FILE</code> a file of your own gets the heights: all its objects and other tags stay, in their order. A node that lies farther than 20 m from where the imported roads have it is not taken for the same.</p>
<h2 id="speeds-on-slopes-osrm-speeds"><a class="self" href="#speeds-on-slopes-osrm-speeds">Speeds on slopes: <code>osrm-speeds</code></a></h2>
<p>The speed is the one at which the engine's power is just what a constant speed needs: <code>P = v (m g sin a + c m g cos a + r A v^2 / 2)</code>, with mass m, gradient angle a, rolling resistance c, drag area A and air of r = 1.2 kg/m3; never more than usual on roads of the class. Uphill it falls with the slope. Downhill it is
bounded by the class, for bicycles by 45 km/h, and for lorries by what engine brake and retarder take up for any length of time, which makes them as slow down a steep hill as up. It is a constant speed: a short climb with a run-up goes faster than this says.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>vehicle</th>
<th>mass</th>
<th>power at the wheel</th>
<th>drag area</th>
<th>rolling resistance</th>
<th>besides</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>car</code></td>
<td>1.5 t</td>
<td>70 kW</td>
<td>0.65 m2</td>
<td>0.012</td>
<td></td>
</tr>
<tr>
<td><code>truck</code></td>
<td>40 t</td>
<td>300 kW</td>
<td>6 m2</td>
<td>0.006</td>
<td>lasting brakes of 350 kW</td>
</tr>
<tr>
<td><code>bicycle</code></td>
<td>90 kg</td>
<td>120 W</td>
<td>0.5 m2</td>
<td>0.007</td>
<td>walks at 3 km/h where it is too steep</td>
</tr>
<tr>
<td><code>e-bike</code></td>
<td>105 kg</td>
<td>100 W</td>
<td>0.55 m2</td>
<td>0.007</td>
<td>250 W more up to 25 km/h</td>
</tr>
</tbody>
</table></div>
<p>Segments that nobody measured have the elevation model's slope, drawn towards the level: by <code>s^2 / (s^2 + e^2)</code> with roads of usually s = 4 % and an error of e = 100 x 1.5 m x sqrt(2) / length. On 20 m it all but vanishes, on a kilometre it is taken as it is. On bridges and in tunnels the model says nothing: level.</p>
<h2 id="proposals-of-incline-maproulette-and-josm"><a class="self" href="#proposals-of-incline-maproulette-and-josm">Proposals of <code>incline</code>: <code>maproulette</code> and <code>josm</code></a></h2>
<p>In OpenStreetMap <code>incline</code> is the practical maximum of a steep section, in percent, positive uphill in the direction in which the way is drawn, and the way is split where the section begins and ends. What is written are suggestions for a person, one at a time: uploading them unseen would be an automated edit, against
OpenStreetMap's code of conduct.</p>
<ul>
<li>A <strong>section</strong> is a run of consecutive segments of a way, each measured at <code>min_percent</code> or more in the same direction (a dip of up to 20 m does not end it), at least <code>min_length_m</code> long. Its mean is <code>z</code> sigmas or more from zero, with sigma as if all segments' errors were one; each segment has <code>min_drives</code>
drives that are heard over most of its length. Where nothing was measured a section ends, and the text says that it may go on.</li>
<li>Its <strong>value</strong> is the steepest 20 m, of those that are steep for sure: a sigma below what was measured.</li>
<li><strong>Today's tag counts</strong>: a number within <code>conflict_percent</code> of one of the way's sections is left in peace; another one, or <code>up</code> where it goes down, is a conflict; <code>up</code> and <code>down</code> of the right direction count as untagged. <code>only=untagged</code> or <code>only=conflict</code> narrows it.</li>
<li><strong>MapRoulette</strong> gets whole ways as tag fixes (<code>cooperativeWork</code>, type 1), and sections that want a split as an ordinary challenge of its own, since a tag fix cannot split a way. <strong>JOSM</strong> gets the ways split, new pieces with negative numbers, tags untouched but for <code>incline</code>, and a node with a <code>note</code> that tells what was
measured. Relations are not in the file: split the way in the layer of the present data, where JOSM takes care of them.</li>
<li>Files that were imported without versions of objects (many extracts have none) yield <code>version=&quot;1&quot;</code> for JOSM, which opens no file without; a note says so. Download the present state before you take anything over.</li>
</ul>
`;export{e as default};
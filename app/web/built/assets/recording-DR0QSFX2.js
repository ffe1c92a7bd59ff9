var e=`<h1 id="what-to-record-with">What to record with</h1>
<p>Any device with satellite positions will do. How sure a slope is after one drive depends on what else it writes: <strong>how fast it climbs</strong> (vertical Doppler velocity) is worth most, then <strong>pressure</strong>, then <strong>altitude</strong>. More drives over the same road help
whatever the device: ten by an ordinary receiver give 0.30 % where one gives 0.60 %. This page says, device by device, what to switch on, and what to expect of it.</p>
<h2 id="what-to-expect"><a class="self" href="#what-to-expect">What to expect</a></h2>
<p>RMSE of the slope of a segment after <strong>one</strong> drive, percent, by how often the device writes. Hilly and flat streets of Karlsruhe (00, 09, 10) with RTK reference; the logs are made from it with the errors of each kind of sensor.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>the log holds</th>
<th>for example</th>
<th>1 s</th>
<th>5 s</th>
<th>10 s</th>
</tr>
</thead>
<tbody>
<tr>
<td>positions, Doppler velocity, pitch, acceleration, with an elevation model (<code>everything</code>)</td>
<td>u-blox NAV-PVT with NAV-ATT and ESF-MEAS</td>
<td>0.54</td>
<td>1.14</td>
<td>1.79</td>
</tr>
<tr>
<td>positions and pressure (<code>barometer</code>)</td>
<td>phone with a barometer, Sensor Logger</td>
<td>0.67</td>
<td>0.91</td>
<td>1.51</td>
</tr>
<tr>
<td>positions and an altimeter's heights (<code>altimeter</code>)</td>
<td>FIT of a bicycle computer with a barometer</td>
<td>0.93</td>
<td>1.20</td>
<td>1.95</td>
</tr>
<tr>
<td>positions and satellite altitudes (<code>altitude</code>)</td>
<td>GPX of a phone</td>
<td>1.69</td>
<td>1.91</td>
<td>2.16</td>
</tr>
<tr>
<td>the same, smoothed by the receiver (<code>filtered altitude</code>)</td>
<td>GPX, FIT without a barometer, Torque</td>
<td>1.71</td>
<td>1.80</td>
<td>2.16</td>
</tr>
<tr>
<td>positions alone, with SRTM (<code>positions and SRTM</code>)</td>
<td>OBD without altitude</td>
<td>3.30</td>
<td>3.29</td>
<td>3.29</td>
</tr>
</tbody>
</table></div>
<p><code>python benchmarks/poor_logs.py ../shared/data/karlsruhe --seeds 3</code>; the names in brackets are its rungs. In every row of it 89 to 98 % of the errors lie within 1.96 of the stated sigmas: a poor log gives wide slopes, not wrong ones. Receivers differ as well:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>one drive in hills</th>
<th>RMSE %</th>
<th>ten together</th>
</tr>
</thead>
<tbody>
<tr>
<td>u-blox M8 class</td>
<td>0.60</td>
<td>0.30</td>
</tr>
<tr>
<td>dual-frequency receiver with corrections (F9P class)</td>
<td>0.36</td>
<td>0.27</td>
</tr>
<tr>
<td>phone, whatever it can measure</td>
<td>1.04</td>
<td>0.44</td>
</tr>
</tbody>
</table></div>
<p><code>python benchmarks/slope_accuracy.py ../shared/data/karlsruhe --method profile --seeds 5 --sequences 09,10</code>, with <code>--profile f9p</code> or <code>--profile phone</code>, and <code>--drives 1,10</code>. What vertical Doppler alone adds to altitudes: 1.66 % becomes 0.66 % on 09, and 2.60 % becomes
0.91 % on 10 (<code>python benchmarks/ablation.py ../shared/data</code>).</p>
<p>Three rules for all of them:</p>
<ul>
<li><strong>Write once a second or more often.</strong> Smart recording, distance filters and battery savers leave out the very points at which the slope changes.</li>
<li><strong>Fix the device to the vehicle.</strong> One that slides, or lies on a seat, has pitch and acceleration of its own. It need not be level: the tilt of the mount is estimated.</li>
<li><strong>Hand in the original.</strong> Files that went through a sports portal have often had their heights replaced by those of an elevation model, which knows no bridges.</li>
</ul>
<h2 id="u-blox-receivers"><a class="self" href="#u-blox-receivers">u-blox receivers</a></h2>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>receiver</th>
<th>enable</th>
<th>why</th>
</tr>
</thead>
<tbody>
<tr>
<td>7, 8, M8, 9, 10 and later</td>
<td>UBX-NAV-PVT</td>
<td>position, both heights, velocity north, east and down, and their accuracies, in one message</td>
</tr>
<tr>
<td>with inertial sensors (M8U, M8L, F9R, F9K)</td>
<td>NAV-ATT, ESF-MEAS, NAV-EOE, ESF-STATUS</td>
<td>pitch, acceleration, rotation, wheel speed; ESF messages have no time of their own, so leave NAV messages on</td>
</tr>
<tr>
<td>4, 5, 6</td>
<td>NAV-SOL, NAV-POSLLH, NAV-VELNED</td>
<td>NAV-SOL (or NAV-STATUS) says whether there is a fix, and the week; without NAV-VELNED there is no vertical velocity</td>
</tr>
<tr>
<td>timing and raw models (M8T, F9P, F9T)</td>
<td>RXM-RAWX, RXM-SFRBX, besides NAV-PVT</td>
<td>positions between high buildings are computed anew (<a href="/docs/positioning">positioning.md</a>)</td>
</tr>
</tbody>
</table></div>
<p>Beside NAV-PVT the older messages are not needed; they are not counted twice. One to five times a second is plenty: the profile is smoothed along the road anyway. The dynamic model for vehicles is <code>automotive</code> (CFG-NAV5). A log without any message that names a
date is read, but placed in January 1980.</p>
<ul>
<li><strong>u-center</strong>: View, Messages, UBX; right-click a message and choose <em>Enable Message</em>; then record with the red button. Upload the <code>.ubx</code> file. Text dumps of the messages view and of the binary console (hexadecimal) are read too.</li>
<li><strong>ubxtool</strong> (gpsd): <code>ubxtool -P 27 -z CFG-MSGOUT-UBX_NAV_PVT_USB,1</code> for generation 9 and 10 (<code>UART1</code> for that port; the number after <code>-P</code> is the receiver's protocol version); for raw data likewise with <code>UBX_RXM_RAWX_USB</code> and <code>UBX_RXM_SFRBX_USB</code>.</li>
<li><strong>gpsd</strong> records what the receiver sends by <code>gpspipe -R -o drive.ubx</code>. Without it the serial port will do: <code>cat /dev/ttyACM0 &gt; drive.ubx</code>, set to raw by <code>stty -F /dev/ttyACM0 raw</code>.</li>
<li><strong>NMEA</strong> only: GGA and RMC (and GST for accuracies). There is no vertical velocity in NMEA: the <code>altitude</code> row, not the first.</li>
</ul>
<h2 id="phones"><a class="self" href="#phones">Phones</a></h2>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>app</th>
<th>what it writes</th>
<th>row to expect</th>
</tr>
</thead>
<tbody>
<tr>
<td><strong>Sensor Logger</strong> (Android, iOS)</td>
<td>positions, barometer, accelerometer, gyroscope, each in a CSV</td>
<td><code>barometer</code>, where the phone has one; switch on Location, Barometer, Accelerometer, Gravity and Gyroscope, and upload the zip</td>
</tr>
<tr>
<td><strong>GnssLogger</strong> (Android)</td>
<td>positions with accuracies; tick <em>Measurements</em> and each satellite's pseudorange and Doppler are there</td>
<td>the phone of the second table with <em>Measurements</em>, else <code>altitude</code></td>
</tr>
<tr>
<td><strong>OsmAnd</strong>, <strong>Locus</strong>, <strong>OpenTracks</strong> and other GPX recorders</td>
<td>positions, altitude, speed, sometimes course and accuracy</td>
<td><code>altitude</code> or <code>filtered altitude</code></td>
</tr>
<tr>
<td>Apple Health's routes, as GPX</td>
<td>positions, altitude, speed, course, both accuracies</td>
<td><code>altitude</code> or <code>filtered altitude</code></td>
</tr>
</tbody>
</table></div>
<p>Of GPX these are read beside position, time and <code>&lt;ele&gt;</code>: <code>speed</code>; <code>course</code>, <code>cog</code> or <code>bearing</code>; <code>geoidheight</code>; <code>hAcc</code>, <code>vAcc</code>, <code>accuracy_horizontal</code>, <code>accuracy_vertical</code>. <code>hdop</code> is a dilution, not an accuracy, and counts only from OsmAnd and Locus, which write metres there. Set the logging interval to one
second, do not let the app snap the track to roads, and switch the battery saver off for it.</p>
<h2 id="garmin-wahoo-and-other-bicycle-computers-and-watches-fit"><a class="self" href="#garmin-wahoo-and-other-bicycle-computers-and-watches-fit">Garmin, Wahoo and other bicycle computers and watches (FIT)</a></h2>
<p>Upload the <code>.fit</code> file from the device (folder <code>Activity</code> or <code>activities</code>) or the <em>original</em> that its portal offers; TCX and GPX made of it hold less.</p>
<ul>
<li><strong>Recording interval: every second</strong>, not <em>Smart</em>: 0.93 % against 1.2 % and more.</li>
<li><strong>A device with a barometer</strong> (most Edge and ELEMNT models; Forerunner 9xx, fenix). Its altitude is what counts: it is late by some seconds, and that lag is estimated together with the slopes. Calibrating it makes heights right; slopes do not need it.</li>
<li>Speed is taken as the vehicle's own signal, from a wheel sensor where there is one. <code>grade</code> is not used: the device derives it from the same altitudes. Heart rate and apps' own fields are ignored.</li>
<li>Pauses of the timer (also automatic ones) are gaps: nothing is carried over them. Switch auto-pause off if you stop at every light.</li>
<li>Virtual and indoor rides, planned courses, settings, dives and whatever else has no positions are refused with that reason. A file that the device never closed, or that was cut off, is read as far as it goes.</li>
<li>Action cameras (VIRB) write velocity in three axes several times a second, and pressure: both are used, and so are calibrated accelerometers and gyroscopes where it can be told from the drive how the camera sits on the vehicle.</li>
</ul>
<p>On real roads: mean grades over about a kilometre of sixteen rides with such computers are 0.16 % (RMSE) from LiDAR's (<code>python benchmarks/long_stretches.py ../shared/data/storuman</code>).</p>
<h2 id="cars-obd-torque-and-the-like"><a class="self" href="#cars-obd-torque-and-the-like">Cars: OBD (Torque and the like)</a></h2>
<p>The bus gives speed, which bridges tunnels; it knows no height. Let the app log <strong>GPS time or device time, latitude, longitude, altitude, GPS speed and vehicle speed (OBD)</strong> once a second. Altitude is then the phone's (<code>filtered altitude</code>); without it slopes come from the elevation model alone (<code>positions and SRTM</code>).
Better: record with GnssLogger, Sensor Logger or a u-blox receiver beside, and hand in both files together (<code>versant upload --together</code>).</p>
<h2 id="rtklib"><a class="self" href="#rtklib">RTKLIB</a></h2>
<p><code>rtkpos</code>, <code>rtknavi</code> and <code>rnx2rtkp</code> write <code>.pos</code> files. Choose Lat/Lon/Height, and switch <em>Output Velocity</em> on (<code>out-outvel=on</code>): without it the drive has heights only. With RTK or PPP positions expect the F9P row, with single-point ones the <code>altitude</code> row or worse between
houses: then hand in the observations themselves (RINEX or UBX) and let Versant position them (<a href="/docs/positioning">positioning.md</a>).</p>
<h2 id="anything-else"><a class="self" href="#anything-else">Anything else</a></h2>
<p>A CSV with <code>time_s</code> (or <code>time</code>), <code>lat_deg</code>, <code>lon_deg</code> and whatever was measured: see <span>Log formats</span>.</p>
`;export{e as default};
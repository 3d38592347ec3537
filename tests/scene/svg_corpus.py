"""Small drawings in the markup of SVG and of the programs that export it, and what becomes of each."""

import re

SPACE = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
DATA = "M20 15h60l12 20-20 40H20z"
SHORT = {
    "space": SPACE,
    "page": f'<svg {SPACE} width="120mm" height="90mm" viewBox="0 0 120 90">',
    "data": DATA,
    "part": f'<path id="part" d="{DATA}" {{}}/>',
    "bar": '<rect x="20" y="15" width="70" height="36" {}/>',
    "thin": 'fill="none" stroke="black" stroke-width="0.15"',
}
"""What stands for words in brackets below; what follows in the brackets are further attributes."""

READ = {
    # -- clip paths
    "clip path by attribute": '<clipPath id="c"><circle cx="50" cy="33" r="25"/></clipPath>[bar clip-path="url(#c)"]',
    "clip path by style": '<clipPath id="c"><circle cx="50" cy="33" r="25"/></clipPath>[bar style="clip-path:url(&quot;#c&quot;)"]',
    "clip path by class": "<style>.cut{clip-path: url(#c)}</style>"
    '<clipPath id="c"><path d="M10 5h50v60h-50z"/></clipPath><g class="cut">[bar]</g>',
    "clip rule": '<clipPath id="c"><path clip-rule="evenodd" d="M10 5h70v60h-70zM10 5h30v60h-30z"/></clipPath>'
    '[bar clip-path="url(#c)"]',
    "clip rule nonzero": '<clipPath id="c"><path d="M10 5h70v60h-70zM10 5h30v60h-30z"/></clipPath>'
    '[bar clip-path="url(#c)"]',
    "clip path of two shapes": '<clipPath id="c"><rect x="10" y="10" width="40" height="30"/>'
    '<circle cx="60" cy="30" r="18"/></clipPath>[bar clip-path="url(#c)"]',
    "clip path of the box": '<clipPath id="c" clipPathUnits="objectBoundingBox"><rect x=".25" y="0" width=".5" '
    'height=".75"/></clipPath>[bar clip-path="url(#c)" transform="rotate(10 50 50)"]',
    "clip path of the box of a group": '<clipPath id="c" clipPathUnits="objectBoundingBox"><circle cx=".5" cy=".5" r=".5"/>'
    '</clipPath><g clip-path="url(#c)" transform="translate(5 5) scale(.8)">[bar]</g>',
    "clip path with transform": '<clipPath id="c" transform="rotate(20 50 40)"><rect x="30" y="20" width="40" height="40"/>'
    '</clipPath><g transform="translate(6 3)">[bar clip-path="url(#c)"]</g>',
    "clip path of a clip path": '<clipPath id="d"><rect x="0" y="0" width="60" height="90"/></clipPath>'
    '<clipPath id="c" clip-path="url(#d)"><circle cx="55" cy="33" r="25"/></clipPath>'
    '[bar clip-path="url(#c)"]',
    "clip path on a child of a clip path": '<clipPath id="d"><rect width="60" height="90"/></clipPath><clipPath id="c">'
    '<circle cx="55" cy="33" r="25" clip-path="url(#d)"/></clipPath>[bar clip-path="url(#c)"]',
    "clip path by use": '<defs><circle id="k" cx="50" cy="33" r="20"/></defs><clipPath id="c"><use xlink:href="#k" x="5"/>'
    '</clipPath>[bar clip-path="url(#c)"]',
    "clip path with what is not displayed": '<clipPath id="c"><rect width="120" height="90" display="none"/>'
    '<circle cx="50" cy="33" r="25" fill="none"/></clipPath>[bar clip-path="url(#c)"]',
    "clip path with its own inheritance": '<g clip-rule="evenodd" visibility="visible"><clipPath id="c"><path '
    'd="M10 5h80v60h-80zM60 0h60v80h-60z"/></clipPath></g>'
    '<g clip-rule="nonzero">[bar clip-path="url(#c)"]</g>',
    "a hole that the clip opens": '<clipPath id="c"><rect x="0" y="0" width="55" height="90"/></clipPath>'
    '<path fill-rule="evenodd" clip-path="url(#c)" d="M20 15h70v40h-70zM40 25h30v20h-30z"/>',
    "clip paths of several groups": '<clipPath id="c"><rect x="30" width="90" height="90"/></clipPath><clipPath id="d">'
    '<rect y="20" width="80" height="70"/></clipPath><g clip-path="url(#c)"><g clip-path="url(#d)">[part]</g></g>',
    "clip path that cuts nothing": '<clipPath id="c"><rect width="120" height="90"/></clipPath>[part clip-path="url(#c)"]',
    "clipped away": '<clipPath id="c"><rect width="9" height="9"/></clipPath>[part]<circle cx="100" cy="70" r="9" '
    'clip-path="url(#c)"/>',
    # -- masks
    "mask": '<mask id="m"><rect x="20" y="15" width="40" height="36" fill="white"/></mask>[bar mask="url(#m)"]',
    "mask with a black line on black": '<mask id="m"><rect width="60" height="90" fill="white"/>'
    '<path d="M70 0v90" stroke="black" stroke-width="4"/></mask>[bar mask="url(#m)"]',
    "mask that ends where a second shape begins": '<mask id="m" x="0" y="0" width="50%" height="1"><rect width="120" '
    'height="90" fill="white"/></mask><g mask="url(#m)"><circle cx="30" cy="30" r="20"/><circle cx="70" cy="30" r="20"/></g>',
    "mask by style": '<mask id="m"><circle cx="50" cy="33" r="17" fill="#fff"/></mask>[bar style="mask:url(#m)"]',
    "mask with black on white": '<mask id="m"><rect width="120" height="90" fill="white"/>'
    '<path d="M60 0h60v90h-60z" fill="black"/></mask>[part mask="url(#m)"]',
    "mask of alpha": '<mask id="m" style="mask-type:alpha" maskUnits="userSpaceOnUse" x="0" y="0" width="60" height="90">'
    '<circle cx="50" cy="40" r="30" fill="#D9D9D9"/></mask><g mask="url(#m)">[bar]</g>',
    "mask within its rectangle": '<mask id="m" x="0" y="0" width="0.5" height="1"><rect width="120" height="90" fill="white"/>'
    '</mask>[bar mask="url(#m)"]',
    "mask of the box": '<mask id="m" maskContentUnits="objectBoundingBox"><rect width=".7" height="1" fill="white"/></mask>'
    '[bar mask="url(#m)" transform="rotate(-8 50 40)"]',
    "mask of a group": '<mask id="m"><g fill="white"><rect x="10" y="10" width="50" height="70"/><circle cx="60" cy="40" '
    'r="20"/></g></mask><g mask="url(#m)">[part]</g>',
    "mask that hides nothing": '<mask id="m" fill="white"><path d="M20 15h60l12 20-20 40H20z"/></mask>'
    '[part mask="url(#m)"]',
    # -- viewports
    "inner drawing that cuts": '<svg x="10" y="10" width="30" height="40"><rect width="50" height="22"/></svg>',
    "inner drawing with overflow": '<svg x="10" y="10" width="30" height="40" overflow="visible"><rect width="50" '
    'height="22"/></svg>',
    "inner drawing with overflow by style": '<svg x="10" y="10" width="30" height="40" style="overflow:visible">'
    '<rect width="50" height="22"/></svg>',
    "inner drawing with a view": '<svg x="10" y="10" width="60" height="40" viewBox="0 0 20 20"><circle cx="12" cy="10" r="11"/>'
    "</svg>",
    "inner drawing that slices": '<svg x="10" y="10" width="60" height="30" viewBox="0 0 20 20" '
    'preserveAspectRatio="xMinYMax slice"><circle cx="10" cy="10" r="10"/></svg>',
    "inner drawing without aspect": '<svg x="10" y="10" width="60" height="30" viewBox="0 0 20 20" preserveAspectRatio="none">'
    '<circle cx="10" cy="10" r="9"/></svg>',
    "inner drawings in each other": '<svg x="10" y="10" width="60" height="60"><svg x="20" y="5" width="70" height="40">'
    '<circle cx="30" cy="20" r="25"/></svg></svg>',
    "inner drawing turned": '<g transform="rotate(15)"><svg x="30" y="10" width="40" height="40"><circle cx="35" cy="20" '
    'r="20"/></svg></g>',
    "symbol that cuts": '<symbol id="s" viewBox="0 0 10 10"><rect width="15" height="6"/></symbol>'
    '<use href="#s" x="10" y="10" width="50" height="50"/>',
    "symbol with overflow": '<symbol id="s" viewBox="0 0 10 10" overflow="visible"><rect width="15" height="6"/></symbol>'
    '<use href="#s" x="10" y="10" width="50" height="50"/>',
    "symbol without a size": '<symbol id="s"><circle cx="40" cy="40" r="30"/></symbol><use href="#s" x="10" y="5"/>',
    "symbol with aspect": '<symbol id="s" viewBox="0 0 10 10" preserveAspectRatio="xMaxYMid meet"><circle cx="5" cy="5" r="5"/>'
    '</symbol><use href="#s" x="10" y="10" width="90" height="40"/>',
    "use of an inner drawing": '<defs><svg id="s" viewBox="0 0 10 10" width="20" height="20"><circle cx="8" cy="5" r="5"/></svg>'
    '</defs><use href="#s" x="10" y="10" width="60" height="60"/>',
    # -- visibility
    "not displayed": '<g display="none"><circle cx="50" cy="40" r="40"/></g>[part]',
    "not displayed by class": '<style>.construction{display:none}</style><rect class="construction" width="110" height="80"/>'
    "[part]",
    "displayed inside what is not": '<g display="none"><rect width="110" height="80" display="inline"/></g>[part]',
    "hidden": '<g visibility="hidden"><rect width="110" height="80"/>[part visibility="visible"]</g>',
    "clear": '<g opacity="0"><rect width="110" height="80" opacity="1"/></g>[part]',
    "half clear": '[part opacity="0.4" fill="#204080"]',
    "clear paint": '<rect width="110" height="80" fill="red" fill-opacity="0"/>[part]',
    "no paint": '<rect width="110" height="80" fill="none"/>[part]',
    "paint of nothing": '<rect width="110" height="80" fill="url(#lost)"/>[part]',
    "paint of nothing with another": '[part fill="url(#lost) navy"]',
    "current color": '<g color="none" fill="currentColor" style="color:#800">[part]</g>',
    "white": '<rect width="110" height="80" fill="hsl(0,0%,100%)"/>[part]',
    # -- fill rules and strokes
    "even-odd": '<path fill-rule="evenodd" d="[data]M30 25h20v20h-20z"/>',
    "nonzero": '<path d="[data]M30 25h20v20h-20z"/>',
    "nonzero, turned": '<path d="[data]M30 25v20h20v-20z"/>',
    "open but filled": '<path d="M20 15h60l12 20-20 40H20"/>',
    "line": '<path d="M20 15h60l12 20-20 40H20z" [thin]/>',
    "lines that meet": '<g [thin]><path d="M20 15h60"/><path d="M80 15 l12 20 l-20 40"/><path d="M72 75H20V15"/></g>',
    "line that the scale thins": '<g transform="scale(.05)"><path d="M400 300h1200l240 400-400 800H400z" fill="none" '
    'stroke="black" stroke-width="4"/></g>',
    "line that is clear": '<rect width="110" height="80" fill="none" stroke="red" stroke-opacity="0"/>[part]',
    "line without width": '<rect width="110" height="80" fill="none" stroke="red" stroke-width="0"/>[part]',
    "dashes around a fill": '[part stroke="black" stroke-width="0.15" stroke-dasharray="2 1"]',
    "dashed construction": '<rect x="10" y="8" width="100" height="75" [thin] stroke-dasharray="2 9"/>[part]',
    # -- transforms
    "transform": '[part transform="translate(50 40) rotate(25) scale(.7 .8) skewX(10) translate(-50 -40)"]',
    "transform by class": '<style>.t { transform: matrix(.8,.1,-.1,.8,12,6) }</style>[part class="t"]',
    "transform origin": '[part transform="rotate(30)" transform-origin="50 40"]',
    "mirror": '[part transform="matrix(-1 0 0 1 120 0)"]',
    "page with an offset": '<svg [space] width="100mm" height="80mm" viewBox="10 5 100 80">[part]</svg>',
    "page in inches": '<svg [space] width="4in" height="3in" viewBox="0 0 120 90">[part]</svg>',
    "page without aspect": '<svg [space] width="100mm" height="40mm" viewBox="0 0 120 90" preserveAspectRatio="none">'
    "[part]</svg>",
    "page at its right": '<svg [space] width="200mm" height="90mm" viewBox="0 0 120 90" preserveAspectRatio="xMaxYMin">'
    "[part]</svg>",
    "page without a size": '<svg [space] viewBox="0 0 120 90">[part]</svg>',
    "page with a width": '<svg [space] width="60mm" viewBox="0 0 120 90">[part]</svg>',
    "page in percent": '<svg [space] width="100%" height="100%" viewBox="0 0 120 90">[part]</svg>',
    # -- units and shapes
    "percent": '<rect x="10%" y="10%" width="50%" height="60%" rx="5%"/>',
    "percent of a circle": '<circle cx="50%" cy="50%" r="25%"/>',
    "millimeters": '<svg [space] width="120mm" height="90mm"><rect x="10mm" y="1cm" width="2in" height="100pt" rx="5pc"/></svg>',
    "rect with one radius": '<rect x="20" y="20" width="60" height="30" ry="12"/>',
    "rect with large radii": '<rect x="20" y="20" width="60" height="30" rx="50" ry="8"/>',
    "ellipse": '<ellipse cx="50" cy="40" rx="40" ry="15" transform="rotate(20 50 40)"/>',
    "polygon": '<polygon points="20,15 80 15 92,35 72 75,20,75"/>',
    "polyline": '<polyline points="20,15 80 15 92,35 72 75,20,75"/>',
    "curves": '<path d="M20 40C20 10 60 10 60 30S80 50 95 40q5 20-20 30T40 60z"/>',
    "arcs": '<path d="M20 40a20 15 30 1140 5A30 30 0 0120 40z"/>',
    # -- structure and style sheets
    "use": '<defs><path id="p" d="M0 0h60l12 20-20 40H0z"/></defs><use xlink:href="#p" x="20" y="15" fill="green"/>',
    "use of a use": '<defs><path id="p" d="M0 0h30l6 10-10 20H0z"/><use id="q" href="#p" transform="scale(2)"/></defs>'
    '<use href="#q" x="20" y="15"/>',
    "use takes the paint of its place": '<defs><g id="p">[part]</g></defs><g fill="none">'
    '<rect width="110" height="80"/></g><use href="#p" fill="#222"/>',
    "switch": '<switch><rect systemLanguage="de" width="110" height="80"/><g systemLanguage="en-US,fr">'
    '[part]</g><rect width="100" height="80"/></switch>',
    "another language": '<rect systemLanguage="ja" width="110" height="80"/>[part]',
    "extensions": '<switch><foreignObject requiredExtensions="http://ns.adobe.com/x" width="1" height="1"/><g>'
    "[part]</g></switch>",
    "style over attribute": '[part fill="none" style="fill:#123456"]',
    "descendants": '<style>g.frame > rect { display: none } svg g rect { fill: red }</style><g class="frame">'
    '<rect width="110" height="80"/></g>[part]',
    "attributes": '<style>rect[data-role="frame"] { visibility: hidden }</style><rect data-role="frame" width="110" '
    'height="80"/>[part]',
    "specificity": '<style>#big{display:none} rect{display:inline}</style><rect id="big" width="110" height="80"/>'
    "[part]",
    "important": '<style>rect{display:none !important}</style><rect style="display:inline" width="110" height="80"/>'
    "[part]",
    "order": '<style>.a{display:inline} .b{display:none}</style><rect class="b a" width="110" height="80"/>[part]',
    "two classes": '<style>.a.b{display:none}</style><rect class="a b" width="110" height="80"/>[part class="a"]',
    "comments and sections": '<style type="text/css"><![CDATA[ /* {} */ .gone { display : none ; } @font-face { font-family: X; } '
    ']]></style><rect class="gone" width="110" height="80"/>[part]',
    "style sheet of another kind": '<style type="text/less">path{display:none}</style>[part]',
    # -- gradients
    "gradient": '<linearGradient id="g"><stop stop-color="#ccc"/><stop offset="1" stop-color="#333"/></linearGradient>'
    '[part fill="url(#g)"]',
    "gradient of a gradient": '<linearGradient id="h"><stop style="stop-color:navy"/><stop offset="1" style="stop-color:#99f"/>'
    '</linearGradient><radialGradient id="g" xlink:href="#h" r=".8"/>[part style="fill:url(#g)"]',
    "opaque clear rest": '<linearGradient id="g"><stop stop-color="#000" stop-opacity=".5"/></linearGradient>'
    '[part fill="url(#g)"]',
}
"""Drawings that are read; a name: what is inside of a page, or a whole file."""

WEB = {
    "clear color": '<rect width="110" height="80" fill="rgb(255 0 0 / 0)"/><rect width="99" height="80" fill="transparent"/>'
    '[part fill="rgb(20% 30% 40% / 0.8)"]',
    "line of a fixed width": '<g transform="scale(20)"><path d="M1 .75h3l.6 1-1 2H1z" fill="none" stroke="black" '
    'stroke-width=".5" vector-effect="non-scaling-stroke"/></g>',
    "transform by style": '[part style="transform: translate(10px, 5px) rotate(8deg) scaleX(0.8)"]',
    "transform origin by style": '[part style="transform: rotate(-20deg); transform-origin: 60px 45px"]',
    "transform origin in percent": '[part style="transform: rotate(0.05turn); transform-origin: 50% 50%"]',
    "variables": "<style>:root { --ink: #246; --gone: none } rect { display: var(--gone) }</style>"
    '<rect width="110" height="80"/>[part style="fill: var(--paint, var(--ink))"]',
    "print": "<style>@media print { path { display: none } } @media screen { rect { display: none } }</style>"
    '<rect width="110" height="80"/>[part]',
    "print alone": '<style media="print">path { display: none }</style>[part]',
    "first of a kind": '<style>rect:nth-of-type(2), rect:not(.body) { display: none }</style><rect x="20" y="15" width="60" '
    'height="40" class="body"/><rect width="110" height="80" class="body"/>',
    "geometry by style": '<style>circle { r: 25px; cx: 50px } rect { rx: 6px }</style><circle cx="3" cy="40" r="1"/>',
    "size by style": '<rect x="20" y="15" style="width: 60px; height: 30px"/>',
}
"""Drawings that are read by the rules of browsers, which the renderer of the other drawings does not know."""

PROGRAMS = {
    "Inkscape": """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<!-- Created with Inkscape (http://www.inkscape.org/) -->
<svg width="210mm" height="297mm" viewBox="0 0 210 297" version="1.1" id="svg5" sodipodi:docname="bracket.svg"
   xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"
   xmlns:sodipodi="http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd" xmlns="http://www.w3.org/2000/svg">
  <sodipodi:namedview id="namedview7" pagecolor="#ffffff" inkscape:document-units="mm" showgrid="false"/>
  <defs id="defs2"><clipPath clipPathUnits="userSpaceOnUse" id="clipPath1">
    <rect style="fill:none;stroke:#000000;stroke-width:0.2" id="rect9" width="80" height="60" x="40" y="50"/></clipPath></defs>
  <g inkscape:label="Layer 1" inkscape:groupmode="layer" id="layer1" transform="translate(3.5,-4)">
    <path style="fill:#4d4d4d;stroke:none;stroke-width:0.264583" clip-path="url(#clipPath1)"
       d="m 50,60 c 20,-15 60,-10 80,5 l -4,40 -30,10 H 50 Z" id="path31" sodipodi:nodetypes="ccccc"/>
  </g>
  <g inkscape:groupmode="layer" id="layer2" inkscape:label="guides" style="display:none">
    <rect id="rect2" width="200" height="250" x="1" y="1"/></g>
</svg>""",
    "Illustrator": """<?xml version="1.0" encoding="utf-8"?>
<!-- Generator: Adobe Illustrator 25.2.1, SVG Export Plug-In . SVG Version: 6.00 Build 0)  -->
<svg version="1.1" id="Layer_1" xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" x="0px"
   y="0px" viewBox="0 0 283.5 198.4" style="enable-background:new 0 0 283.5 198.4;" xml:space="preserve">
<style type="text/css">
	.st0{clip-path:url(#SVGID_2_);}
	.st1{fill:#E6332A;}
	.st2{fill:none;}
</style>
<g>
	<defs><rect id="SVGID_1_" x="28.3" y="28.3" width="170" height="113"/></defs>
	<clipPath id="SVGID_2_"><use xlink:href="#SVGID_1_"  style="overflow:visible;"/></clipPath>
	<g class="st0"><path class="st1" d="M56.7,85c0-31.3,38.1-56.7,85-56.7s113.4,25.4,113.4,56.7s-38.1,85-85,85S56.7,116.3,56.7,85z"
		/></g>
	<rect class="st2" width="283.5" height="198.4"/>
</g>
</svg>""",
    "Illustrator of old": """<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd" [
	<!ENTITY ns_extend "http://ns.adobe.com/Extensibility/1.0/">
	<!ENTITY ns_ai "http://ns.adobe.com/AdobeIllustrator/10.0/">
	<!ENTITY ns_svg "http://www.w3.org/2000/svg">
]>
<svg version="1.1" xmlns:x="&ns_extend;" xmlns:i="&ns_ai;" xmlns="&ns_svg;" width="300px" height="200px"
	 viewBox="0 0 300 200" xml:space="preserve">
<switch>
	<foreignObject requiredExtensions="&ns_ai;" x="0" y="0" width="1" height="1"><i:pgfRef/></foreignObject>
	<g i:extraneous="self"><polygon fill="#1D1D1B" points="40,30 240,50 260,150 60,170 	"/></g>
</switch>
</svg>""",
    "Figma": """<svg width="320" height="240" viewBox="0 0 320 240" fill="none" xmlns="http://www.w3.org/2000/svg">
<g clip-path="url(#clip0_1_2)">
<rect width="320" height="240" fill="white"/>
<mask id="mask0_1_2" style="mask-type:alpha" maskUnits="userSpaceOnUse" x="40" y="30" width="200" height="150">
<path d="M40 30H240V180H40V30Z" fill="#D9D9D9"/>
</mask>
<g mask="url(#mask0_1_2)">
<path fill-rule="evenodd" clip-rule="evenodd" d="M60 50C60 38.9543 68.9543 30 80 30H280V200H60V50ZM120 90V140H180V90H120Z" fill="#0D99FF"/>
</g>
</g>
<defs>
<clipPath id="clip0_1_2"><rect width="320" height="240" fill="white"/></clipPath>
</defs>
</svg>""",
    "Figma frame": """<svg width="200" height="200" viewBox="0 0 200 200" fill="none" xmlns="http://www.w3.org/2000/svg">
<mask id="path-1-inside-1_3_4" fill="white"><path d="M40 60C40 48.9543 48.9543 40 60 40H160V150H40V60Z"/></mask>
<path d="M40 60C40 48.9543 48.9543 40 60 40H160V150H40V60Z" fill="#D9D9D9"/>
<path d="M60 40V41H160V40V39H60V40Z" fill="black" mask="url(#path-1-inside-1_3_4)"/>
</svg>""",
    "CorelDRAW": """<?xml version="1.0" encoding="UTF-8"?>
<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">
<!-- Creator: CorelDRAW 2020 -->
<svg xmlns="http://www.w3.org/2000/svg" xml:space="preserve" width="100mm" height="80mm" version="1.1"
style="shape-rendering:geometricPrecision; text-rendering:geometricPrecision; fill-rule:evenodd; clip-rule:evenodd"
viewBox="0 0 10000 8000" xmlns:xlink="http://www.w3.org/1999/xlink" xmlns:xodm="http://www.corel.com/coreldraw/odm/2003">
 <defs>
  <style type="text/css">
   <![CDATA[
    .str0 {stroke:#2B2A29;stroke-width:7.62;stroke-miterlimit:22.9256}
    .fil1 {fill:none}
    .fil0 {fill:#2B2A29;fill-rule:nonzero}
   ]]>
  </style>
 </defs>
 <g id="Layer_x0020_1"><metadata id="CorelCorpID_0Corel-Layer"/>
  <path class="fil1 str0" d="M1500 1200l5200 0c800,0 1400,700 1400,1500l0 2600c0,900 -700,1500 -1500,1500l-5100 0 0 -5600z"/>
 </g>
</svg>""",
    "FreeCAD": """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<svg xmlns="http://www.w3.org/2000/svg" version="1.1" width="70.02mm" height="50.02mm" viewBox="0 0 70.02 50.02">
<g id="Body" transform="translate(0.01,50.01) scale(1,-1)">
<path id="Body_w0000"  d="M 10.0 0.0 L 60.0 0.0 A 10.0 10.0 0.0 0 1 70.0 10.0 L 70.0 50.0 L 0.0 50.0 L 0.0 10.0 A 10.0 10.0 0.0 0 1 10.0 0.0 Z M 40 25 A 5 5 0 1 0 30 25 A 5 5 0 1 0 40 25 Z" stroke="#000000" stroke-width="0.02 px" style="stroke-width:0.02;stroke-miterlimit:4;stroke-dasharray:none;stroke-linecap:square;fill:#cccccc;fill-rule: evenodd"/>
<title>b'Body'</title>
</g></svg>""",
    "FreeCAD of TechDraw": """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<svg width="297mm" height="210mm" viewBox="0 0 297 210" xmlns="http://www.w3.org/2000/svg" version="1.2"
 baseProfile="tiny"><title>Page</title><defs/>
<g fill="none" stroke="black" stroke-width="1" fill-rule="evenodd" stroke-linecap="square" stroke-linejoin="bevel">
<g fill="none" stroke="#000000" stroke-opacity="1" stroke-width="4" stroke-linecap="round" transform="matrix(0.1,0,0,-0.1,100,120)">
<path vector-effect="none" fill-rule="evenodd" d="M-500,-300 L500,-300 L500,200 C500,255 455,300 400,300 L-500,300 L-500,-300"/></g>
</g></svg>""",
    "Fusion": """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="8cm" height="6cm"
 viewBox="-1 -5 8 6" version="1.1">
<g transform="scale(1,-1)" fill="none" stroke="rgb(0,0,0)" stroke-width="0.0035mm" stroke-linejoin="round">
<g id="Sketch1"><line x1="0" y1="0" x2="6" y2="0"/><line x1="6" y1="0" x2="6" y2="3"/>
<path d="M 6 3 A 1 1 0 0 1 5 4"/><line x1="5" y1="4" x2="0" y2="4"/><line x1="0" y1="4" x2="0" y2="0"/></g>
</g></svg>""",
    "Onshape": """<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg" width="110" height="80" viewBox="-55 -40 110 80">
<g id="FACE1" style="fill:#999999;fill-opacity:0.25;stroke:#000000;stroke-width:0.1px" transform="matrix(1 0 0 -1 0 0)">
<path d="M-50,-30L50,-30L50,20A10,10,0,0,1,40,30L-50,30Z"/></g></svg>""",
    "LibreOffice": """<?xml version="1.0" encoding="UTF-8"?>
<svg version="1.2" width="100mm" height="80mm" viewBox="0 0 10000 8000" preserveAspectRatio="xMidYMid" fill-rule="evenodd"
 stroke-width="28.222" stroke-linejoin="round" xmlns="http://www.w3.org/2000/svg" xml:space="preserve">
 <defs class="ClipPathGroup">
  <clipPath id="presentation_clip_path" clipPathUnits="userSpaceOnUse"><rect x="0" y="0" width="10000" height="8000"/></clipPath>
  <clipPath id="presentation_clip_path_shrink" clipPathUnits="userSpaceOnUse"><rect x="10" y="8" width="9980" height="7984"/>
  </clipPath>
 </defs>
 <defs class="TextShapeIndex"><g ooo:slide="id1" ooo:id-list="id3" xmlns:ooo="http://xml.openoffice.org/svg/export"/></defs>
 <g class="SlideGroup"><g><g id="container-id1"><g id="id1" class="Slide" clip-path="url(#presentation_clip_path)">
  <g class="Page"><g class="com.sun.star.drawing.CustomShape"><g id="id3">
   <rect class="BoundingBox" stroke="none" fill="none" x="1000" y="900" width="7003" height="5003"/>
   <path fill="rgb(114,159,207)" stroke="none" d="M 4500,5900 L 1000,5900 1000,900 8000,900 8000,4200 4500,5900 Z"/>
   <path fill="none" stroke="rgb(52,101,164)" d="M 4500,5900 L 1000,5900 1000,900 8000,900 8000,4200 4500,5900 Z"/>
  </g></g></g></g></g></g></g>
</svg>""",
    "matplotlib": """<?xml version="1.0" encoding="utf-8" standalone="no"?>
<svg xmlns:xlink="http://www.w3.org/1999/xlink" width="288pt" height="216pt" viewBox="0 0 288 216" xmlns="http://www.w3.org/2000/svg" version="1.1">
 <defs><style type="text/css">*{stroke-linejoin: round; stroke-linecap: butt}</style></defs>
 <g id="figure_1"><g id="patch_1"><path d="M 0 216 L 288 216 L 288 0 L 0 0 z" style="fill: #ffffff"/></g>
  <g id="axes_1"><g id="patch_2"><path d="M 50 160 L 230 180 L 250 40 L 70 30 z" clip-path="url(#p1)" style="fill: #1f77b4"/></g></g>
 </g>
 <defs><clipPath id="p1"><rect x="36" y="25.92" width="190" height="166.32"/></clipPath></defs>
</svg>""",
    "draw.io": """<?xml version="1.0" encoding="UTF-8"?>
<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">
<svg xmlns="http://www.w3.org/2000/svg" style="background-color: rgb(255, 255, 255);" version="1.1" width="241px"
 height="181px" viewBox="-0.5 -0.5 241 181"><defs/><g><g data-cell-id="2"><g>
 <path d="M 40 20 L 200 20 L 220 90 L 200 160 L 40 160 Z" fill="#dae8fc" stroke="#6c8ebf" stroke-width="0.3" pointer-events="all"/>
 </g></g></g></svg>""",
    "Potrace": """<?xml version="1.0" standalone="no"?>
<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 20010904//EN" "http://www.w3.org/TR/2001/REC-SVG-20010904/DTD/svg10.dtd">
<svg version="1.0" xmlns="http://www.w3.org/2000/svg" width="300.000000pt" height="220.000000pt"
 viewBox="0 0 300.000000 220.000000" preserveAspectRatio="xMidYMid meet">
<g transform="translate(0.000000,220.000000) scale(0.100000,-0.100000)" fill="#000000" stroke="none">
<path d="M400 1800 c-200 -300 -100 -900 200 -1300 500 -300 1500 -200 1900 200 100 400 0 900 -300 1200 -600 200 -1300 200
-1800 -100z m600 -500 c100 100 300 100 400 0 100 -100 0 -300 -200 -300 -200 0 -300 200 -200 300z"/></g></svg>""",
    "OpenSCAD": """<?xml version="1.0" standalone="no"?>
<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">
<svg width="51mm" height="41mm" viewBox="-1 -41 51 41" xmlns="http://www.w3.org/2000/svg" version="1.1">
<title>OpenSCAD Model</title>
<path d="
M 49,-1 L 49,-30 L 40,-39 L 0,-39 L 0,-1 z
M 10,-10 L 20,-10 L 20,-20 L 10,-20 z
" stroke="black" fill="lightgray" stroke-width="0.05"/></svg>""",
    "Sketch": """<?xml version="1.0" encoding="UTF-8"?>
<svg width="160px" height="120px" viewBox="0 0 160 120" version="1.1" xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">
    <title>Part</title>
    <defs><path d="M20,20 L120,20 C131,20 140,29 140,40 L140,100 L20,100 Z" id="path-1"></path></defs>
    <g id="Page-1" stroke="none" stroke-width="1" fill="none" fill-rule="evenodd">
        <mask id="mask-2" fill="white"><use xlink:href="#path-1"></use></mask>
        <g id="Mask"></g>
        <rect id="Rectangle" fill="#D8D8D8" mask="url(#mask-2)" x="10" y="10" width="140" height="100"></rect>
    </g>
</svg>""",
}
"""Files in the markup that programs export."""

REFUSED = {
    "blur": (
        '<filter id="f"><feGaussianBlur stdDeviation="9"/></filter>[part filter="url(#f)"]',
        "filter of path 'part'",
    ),
    "shadow by style": ('<g id="all" style="filter: drop-shadow(9px 9px 3px red)">[part]</g>', "filter of g 'all'"),
    "circle of CSS": ('[bar id="q" style="clip-path: circle(20px)"]', "clip-path of rect 'q'"),
    "clip path of nothing": (
        '[bar id="q" clip-path="url(#lost)"]',
        r"clip-path of rect 'q': 'url\(#lost\)' is no clip-path",
    ),
    "clip path of another file": ('[bar id="q" clip-path="url(a.svg#c)"]', "clip-path of rect 'q'"),
    "clip path of itself": (
        '<clipPath id="c"><circle r="9" clip-path="url(#c)"/></clipPath>[bar id="q" clip-path="url(#c)"]',
        "clip-path of .*refers to itself",
    ),
    "clip path of letters": (
        '<clipPath id="c"><text y="50" font-size="60">O</text></clipPath>[bar id="q" clip-path="url(#c)"]',
        "clip-path of rect 'q': it has text",
    ),
    "clip": ('<svg id="q" width="60" height="60" style="clip: rect(0, 20px, 20px, 0)">[part]</svg>', "clip of svg 'q'"),
    "mask of a gradient": (
        '<linearGradient id="g"><stop stop-color="#fff"/><stop offset="1" stop-color="#000"/></linearGradient>'
        '<mask id="m"><rect id="v" width="120" height="90" fill="url(#g)"/></mask>[bar id="q" mask="url(#m)"]',
        "mask of rect 'q'",
    ),
    "mask of gray": (
        '<mask id="m"><rect id="v" width="60" height="90" fill="#888"/></mask>[bar id="q" mask="url(#m)"]',
        "mask of rect 'q': rect 'v', which is neither black nor white",
    ),
    "mask of strokes": (
        '<mask id="m"><path id="v" d="M0 30h120" stroke="white" stroke-width="20"/></mask>[bar id="q" mask="url(#m)"]',
        "mask of rect 'q': path 'v', which is a stroke",
    ),
    "mask with a black line on white": (
        '<mask id="m"><rect width="120" height="90" fill="white"/><path id="v" d="M50 0v90" stroke="black" '
        'stroke-width="4"/></mask>[bar id="q" mask="url(#m)"]',
        "mask of rect 'q': path 'v', which is a stroke",
    ),
    "mask of letters": (
        '<mask id="m"><text y="60" font-size="70" fill="white">OO</text></mask>[bar id="q" mask="url(#m)"]',
        "mask of rect 'q': it has text",
    ),
    "mask of nothing": ('[bar id="q" mask="url(#lost)"]', "mask of rect 'q'"),
    "mask of a picture": (
        '[bar id="q" style="mask-image: linear-gradient(black, transparent)"]',
        "mask-image of rect 'q'",
    ),
    "pattern": (
        '<pattern id="p" width="4" height="4" patternUnits="userSpaceOnUse"><path d="M0 0h2v4h-2z"/></pattern>[part fill="url(#p)"]',
        "path 'part' .* has a pattern, '#p'",
    ),
    "gradient that fades": (
        '<linearGradient id="g"><stop stop-color="#000"/><stop offset="1" stop-opacity="0"/></linearGradient>'
        '[part fill="url(#g)"]',
        "path 'part' .* fades out in the gradient '#g'",
    ),
    "paint of another file": ('[part fill="url(a.svg#g)"]', "path 'part' .* has a paint, 'a.svg#g'"),
    "color of tomorrow": ('[part fill="oklch(0.5 0.1 20)"]', "path 'part' .* has the color 'oklch"),
    "markers": (
        '<marker id="m" markerWidth="9" markerHeight="9"><circle r="9"/></marker>[part marker-mid="url(#m)"]',
        "path 'part' .* has markers",
    ),
    "markers by style": (
        '<style>path{marker: url(#m)}</style><marker id="m" markerWidth="9" markerHeight="9"><circle r="9"/></marker>'
        "[part]",
        "path 'part' .* has markers",
    ),
    "thick line": (
        '<path id="part" d="M30 20h40v40h-40z" fill="none" stroke="black" stroke-width="15"/>',
        "drawn by a line 15 mm wide",
    ),
    "thick line around a fill": (
        '<circle id="q" cx="50" cy="40" r="20" stroke="black" stroke-width="15"/>',
        "drawn by a line 15 mm wide",
    ),
    "thick lines that meet": (
        '<g fill="none" stroke="black" stroke-width="8"><path d="M20 15h60v50"/><path d="M80 65H20v-50"/></g>',
        "drawn by a line 8 mm wide",
    ),
    "dashed alone": (
        '<rect id="q" x="20" y="15" width="60" height="40" [thin] stroke-dasharray="3"/>',
        "rect 'q' .*: dashed",
    ),
    "motion": (
        '<path id="part" d="[data]"><animateTransform attributeName="transform" type="rotate" to="90" dur="1s"/></path>',
        "animateTransform in path 'part'",
    ),
    "motion by style": (
        "<style>@keyframes t{to{transform:rotate(1turn)}} path{animation: t 1s}</style>[part]",
        "animation of path 'part'",
    ),
    "turn of tomorrow": ('[part style="rotate: 30deg"]', "rotate of path 'part'"),
    "transform about its box": (
        '[part style="transform: rotate(30deg); transform-box: fill-box; transform-origin: center"]',
        "transform-box of path 'part'",
    ),
    "transform in millimeters": ('[part style="transform: translate(9mm, 0)"]', "path 'part': transform = "),
    "transform in space": ('[part style="transform: rotateX(30deg)"]', "path 'part': transform = "),
    "blend": ('[part style="mix-blend-mode: difference" fill="white"]', "mix-blend-mode of path 'part'"),
    "media of the viewer": (
        "<style>@media (min-width: 600px) { path { display: none } }</style>[part]",
        r"@media \(min-width: 600px\)",
    ),
    "import": ('<style>@import url("a.css");</style>[part]', "@import"),
    "sheet in another file": (
        '<?xml-stylesheet href="a.css" type="text/css"?>[page][part]</svg>',
        "style sheet in another file",
    ),
    "selector of tomorrow": ("<style>path:is-nice { display: none }</style>[part]", "selector 'path:is-nice'"),
    "letters alone": ('<text id="t" x="20" y="60" font-size="60">O</text>', "no closed curve .* text"),
    "picture alone": ('<image width="60" height="60" href="a.png"/>', "no closed curve .* image"),
    "words of HTML": (
        '<foreignObject width="60" height="60"><p xmlns="http://www.w3.org/1999/xhtml">O</p></foreignObject>',
        "no closed curve .* foreignObject",
    ),
    "use of another file": ('<use href="a.svg#part"/>', "no closed curve .* use of 'a.svg#part'"),
    "off the page": ('<rect id="q" x="90" y="20" width="60" height="40"/>', "rect 'q' .* reaches beyond the page"),
    "beside the page": (
        '<rect id="q" x="190" y="20" width="60" height="40"/>',
        "no closed curve .* rect 'q' .*: outside of the page",
    ),
    "size by letters": ('<rect id="q" x="20" y="15" width="3em" height="20"/>', "rect 'q': width = '3em'"),
    "size by a sum": (
        '<rect id="q" x="20" y="15" height="20" style="width: calc(20px + 5%)"/>',
        "rect 'q': width = 'calc",
    ),
    "two shapes": ('[part]<circle cx="100" cy="70" r="9"/>', "2 outer curves"),
    "two parts by a clip": (
        '<clipPath id="c"><path d="M0 0h40v90h-40zM60 0h60v90h-60z"/></clipPath>[bar id="q" clip-path="url(#c)"]',
        r"2 outer curves.*path: q\[2\]; .*path: q\[1\]",
    ),
    "a line that the clip opens": (
        '<clipPath id="c"><rect width="60" height="90"/></clipPath><rect id="q" x="20" y="15" width="70" '
        'height="36" [thin] clip-path="url(#c)"/>',
        "no closed curve .* rect 'q' .*: open",
    ),
    "white on the part": (
        '[part]<circle id="q" cx="20" cy="40" r="9" fill="white"/>',
        "circle 'q' .* is white and covers",
    ),
    "turned root": (
        '<svg [space] width="120mm" height="90mm" viewBox="0 0 120 90" transform="rotate(20)">[part]</svg>',
        "svg: transform is not read",
    ),
}
"""Drawings that are refused, each with the reason that the error names."""

LEFT_OUT = {
    "letters": ('[part]<text x="30" y="40" fill="white">A</text>', "text"),
    "arrow": (
        '<marker id="m"><path d="M0 0h9v9z"/></marker>[part]<path id="axis" d="M5 80h60" stroke="black" '
        'stroke-width=".2" marker-end="url(#m)"/>',
        "path 'axis' .*: open.*marker of path 'axis'",
    ),
    "dashes": (
        '[part]<rect id="q" x="8" y="8" width="100" height="75" [thin] stroke-dasharray="1 9"/>',
        "rect 'q' .*: dashed",
    ),
    "width": ('[part stroke="black" stroke-width="1"]', "half of its line, which is 1 mm wide"),
    "hidden": ('[part]<rect width="110" height="80" visibility="hidden"/>', "shape that is not visible"),
    "picture": ('[part]<image width="9" height="9" href="a.png"/>', "image"),
    "beside": ('[part]<rect id="q" x="190" y="20" width="9" height="9"/>', "rect 'q' .*: outside of the page"),
    "unknown": ("[part]<flowRoot><flowPara>A</flowPara></flowRoot>", "flowRoot"),
}
"""Drawings that are read without a part, which the note of the outline names."""


def document(text: str) -> str:
    """A whole file."""
    whole = text if re.match(r"<svg ([^>]*xmlns|\[space\])|<[?!]", text) else f"[page]{text}</svg>"
    return re.sub(
        r"\[(\w+)(?: ([^\]]*))?\]", lambda m: SHORT[m[1]].format(m[2] or "") if m[1] in SHORT else m[0], whole
    )

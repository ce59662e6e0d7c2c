"""Two or three examples of each command for its ``--help``: what it does in words, and the line to type."""

from __future__ import annotations

_PAIR = "2024-05-01.laz 2025-05-01.laz"

EXAMPLES: dict[str, tuple[tuple[str, str], ...]] = {
    "inspect": (
        (
            "Two surveys whose names hold their days",
            (
                "slopewatch inspect --epoch 2024-05-01.laz --epoch 2025-05-01.laz \\\n"
                "    --roi slope.gpkg --output-dir results"
            ),
        ),
        (
            "Days given, and the settings of an earlier run with another cell",
            (
                "slopewatch inspect --epoch 2024-05-01=may.laz --epoch 2025-05-01=later.laz \\\n"
                "    --roi slope.gpkg --settings results/run.json --cell 0.2 --output-dir coarser"
            ),
        ),
        ("One survey, which is screened", "slopewatch inspect --epoch 2025-05-01.laz --output-dir screened"),
    ),
    "series": (
        ("All surveys in a folder", "slopewatch series surveys --roi slope.gpkg --output-dir results"),
        (
            "Surveys that are listed in a table, as ground that is ready",
            "slopewatch series surveys.csv --ground as_is --output-dir results",
        ),
    ),
    "batch": (
        ("All slopes of a table, two at a time", "slopewatch batch slopes.csv --workers 2 --output-dir corridor"),
        (
            "With chainages along the road's line",
            "slopewatch batch slopes.gpkg --centreline road.gpkg --output-dir corridor",
        ),
    ),
    "screen": (
        ("Ground points of one survey", "slopewatch screen ground.laz --output labelled.laz"),
        (
            "A raw survey, whose ground is extracted first",
            "slopewatch screen 2025-05-01.laz --ground extract --roi slope.gpkg --output labelled.laz",
        ),
        (
            "How small a hazard is found on this ground",
            "slopewatch screen ground.laz --self-test --output labelled.laz",
        ),
    ),
    "ground": (
        ("The slope's ground", "slopewatch ground 2024-05-01.laz --roi slope.gpkg --output ground.laz"),
        (
            "Finer relief on a terraced slope",
            "slopewatch ground 2024-05-01.laz --cloth-resolution 0.3 --rigidness 2 --output ground.laz",
        ),
    ),
    "register": (
        (
            "By all ground that fits",
            f"slopewatch register {_PAIR} \\\n    --output aligned.laz --transform transform.json",
        ),
        (
            "By the road only",
            f"slopewatch register {_PAIR} \\\n    --stable road.gpkg --output aligned.laz",
        ),
        (
            "With a transform that is known",
            "slopewatch register first.laz raw.laz --apply transform.json --output moved.laz",
        ),
    ),
    "change": (
        ("Two ground clouds that fit", f"slopewatch change {_PAIR} --output-dir change"),
        (
            "The later one is moved first, and its registration's error is taken from the transform",
            f"slopewatch change {_PAIR} \\\n    --transform transform.json --output-dir change",
        ),
        (
            "Cells of 0.25 m, and profiles along lines",
            f"slopewatch change {_PAIR} --cell 0.25 \\\n    --profiles lines.gpkg --output-dir change",
        ),
    ),
    "displacement": (
        ("Two registered ground clouds", f"slopewatch displacement {_PAIR} --output-dir motion"),
        (
            "With the registration's error, and its shift as it shows on ground that is known to be stable",
            (
                f"slopewatch displacement {_PAIR} \\\n"
                "    --transform transform.json --stable road.gpkg --output-dir motion"
            ),
        ),
    ),
    "m3c2": (
        ("A steep face", f"slopewatch m3c2 {_PAIR} --roi slope.gpkg --output distances.laz"),
        (
            "At the points of a third cloud, with a cylinder of 0.5 m",
            f"slopewatch m3c2 {_PAIR} --core points.laz \\\n    --projection-scale 0.5 --output distances.laz",
        ),
    ),
    "demchange": (
        (
            "Two elevation models, the bias and the shift of the later one taken off",
            "slopewatch demchange dem_2015.tif dem_2023.tif --output-dir change",
        ),
        (
            "With their days, and ground known to be stable",
            "slopewatch demchange 2015-03-01=a.tif 2023-02-15=b.tif \\\n    --stable roads.gpkg --output-dir change",
        ),
    ),
    "report": (
        ("The report of a folder again", "slopewatch report results"),
        ("With profiles along lines", "slopewatch report results --profiles lines.gpkg --zone-profiles 5"),
        (
            "A PDF to sign, with the details in a file",
            "slopewatch report results --pdf --settings details.toml --author 'A. Sato'",
        ),
    ),
    "exportgis": (
        ("Everything that other systems read, in one archive", "slopewatch exportgis results --output slope_12.zip"),
        (
            "Under the agency's field names, for GIS and road design only",
            (
                "slopewatch exportgis results --fields names.csv --formats gpkg,dxf,landxml,iso \\\n"
                "    --output hand_over"
            ),
        ),
        (
            "Into the agency's database; the password is in ~/.pgpass",
            "slopewatch exportgis corridor --to postgresql://slopes@db.example.org/roads --srid 27700",
        ),
    ),
    "createproject": (
        (
            "Next to the results, so that both can be moved",
            "slopewatch createproject results --output results/slope.qgz",
        ),
        (
            "With a title block for a sheet of A3",
            (
                'slopewatch createproject results --project-title "Slope 12" --author "A. Sato" --paper A3 \\\n'
                "    --output results/slope.qgz"
            ),
        ),
    ),
    "info": (
        ("What a cloud holds", "slopewatch info 2024-05-01.laz"),
        ("The same for a program", "slopewatch info 2024-05-01.laz --progress json"),
    ),
    "topview": (
        ("A raw cloud as rasters to draw on", "slopewatch topview 2024-05-01.laz --output-dir view"),
        (
            "Cells of 0.2 m within a region, with the shade of the highest returns",
            "slopewatch topview 2024-05-01.laz --roi slope.gpkg --cell 0.2 --hillshade highest --output-dir view",
        ),
    ),
    "locate": (
        (
            "The zones of a former run",
            "slopewatch locate results/zones.gpkg --centreline road.gpkg --output located.gpkg",
        ),
        (
            "Under the agency's names",
            "slopewatch locate drains.shp --centreline network.gpkg --field-names names.csv --output drains.gpkg",
        ),
    ),
    "suggestroi": (
        ("The dense and whole part of a cloud", "slopewatch suggestroi 2024-05-01.laz --output region.gpkg"),
        (
            "Only its largest part, with smooth edges",
            "slopewatch suggestroi 2024-05-01.laz --smallest-part 1 --simplification 2 --output region.gpkg",
        ),
    ),
    "planflight": (
        (
            "Over an elevation model, bare ground assumed",
            "slopewatch planflight dem.tif --roi slope.gpkg --output-dir plan",
        ),
        (
            "Over the last survey's ground, with the plants that survey saw",
            "slopewatch planflight ground.laz --survey 2025-05-01.laz \\\n    --roi slope.gpkg --output-dir plan",
        ),
        (
            "The best season by surveys of several months, and mission files for an M350 RTK",
            (
                "slopewatch planflight ground.laz --season 2025-03-10.laz --season 2025-07-15.laz \\\n"
                "    --wpml-drone 89 --wpml-payload 65534 --takeoff-height 412.3 \\\n"
                "    --takeoff-ellipsoid-height 421.8 --roi slope.gpkg --output-dir plan"
            ),
        ),
    ),
    "compareflight": (
        (
            "With the trajectory, and the ground of the survey flown",
            (
                "slopewatch compareflight plan/plan.gpkg 2026-05-01.laz --ground ground.laz \\\n"
                "    --trajectory flown.csv --output-dir flown"
            ),
        ),
        (
            "By the scan angles of the cloud",
            "slopewatch compareflight plan/plan.gpkg 2026-05-01.laz --output-dir flown",
        ),
    ),
    "exportlabelstudio": (
        ("A top view to label", "slopewatch exportlabelstudio view/picture.tif --output-dir tasks"),
        (
            "With zones on it, whose kind is their label",
            "slopewatch exportlabelstudio view/picture.tif --segments results/zones.gpkg --output-dir tasks",
        ),
    ),
    "importlabelstudio": (
        (
            "What was drawn as a layer",
            "slopewatch importlabelstudio export.json --tasks tasks/tasks.json --output labels.gpkg",
        ),
        (
            "Again, after more was drawn",
            "slopewatch importlabelstudio export.json --tasks tasks/tasks.json --output labels.gpkg --overwrite",
        ),
    ),
    "train": (
        ("Clouds whose points are labelled", "slopewatch train first.laz second.laz third.laz --output-dir model"),
        (
            "Clouds with polygons, for half an hour",
            "slopewatch train first.laz second.laz --polygons hazards.gpkg --minutes 30 --output-dir model",
        ),
    ),
    "simulate survey": (
        ("A slope to try SlopeWatch on", "slopewatch simulate survey --output-dir demo"),
        (
            "A small one with little vegetation",
            "slopewatch simulate survey --points 100000 --length 30 --vegetation 0.2 --output-dir demo",
        ),
        (
            "One whose ground slides, turns, creeps and slumps",
            "slopewatch simulate survey --motion all --motion-amount 0.2 --output-dir demo",
        ),
    ),
    "simulate series": (
        ("Six surveys with zones that creep", "slopewatch simulate series --output-dir demo"),
        (
            "Twelve, with two zones of known velocities",
            'slopewatch simulate series --surveys 12 --velocities "-8, 3" --output-dir demo',
        ),
    ),
    "simulate scenes": (
        ("Three labelled slopes", "slopewatch simulate scenes --output-dir scenes"),
        (
            "Twenty with hazards as rare as on real slopes",
            "slopewatch simulate scenes --kind realistic --count 20 --output-dir scenes",
        ),
    ),
    "check": (
        ("Whether everything is there", "slopewatch check"),
        ("Whether a PDAL of your own works", "slopewatch check --pdal /usr/local/bin/pdal"),
    ),
    "parameters": (
        ("All that can be set of the whole flow", "slopewatch parameters inspect"),
        ("The same of a simulation", "slopewatch parameters simulate survey"),
    ),
}

"""Names of parameters, groups and outputs that have been released, and the commands of the algorithms.

Scripts and models of users hold them. Add to them, never change or remove one.
"""

from __future__ import annotations

INPUT = ["CRS", "HEIGHT_UNIT"]
GROUND = [
    "SLOPE_ALIGNED", "CLOTH_RESOLUTION", "RIGIDNESS", "CLASS_THRESHOLD", "TIME_STEP", "ITERATIONS", "SLOPE_SMOOTHING",
    "REFINE", "CLOTH_REACH", "LAST_RETURNS", "DENOISE", "DENOISE_RADIUS", "DENOISE_GROUP", "MINIMUM_GROUND_RATIO",
    "GROUND_MEMORY",
]  # fmt: skip
REGISTRATION = [
    "METHOD", "MAXIMUM_OFFSET", "MAXIMUM_CORRESPONDENCE", "REGISTRATION_ITERATIONS", "REGISTRATION_VOXEL",
    "MINIMUM_STABLE_SHARE",
]  # fmt: skip
CHANGE = [
    "CELL", "CELL_VALUE", "MINIMUM_POINTS", "CONFIDENCE", "THRESHOLD", "CONSTANT_LEVEL", "ERROR_FROM", "ERROR_TO",
    "DIRECTION", "CALIBRATE", "REGISTRATION_ERROR", "ADAPTIVE", "TARGET_LEVEL", "LARGEST_CELL", "MEMORY_LIMIT",
]  # fmt: skip
# a series has one grid for all its surveys
ONE_SIZE = [name for name in CHANGE if name not in ("ADAPTIVE", "TARGET_LEVEL", "LARGEST_CELL")]
ZONES = ["MINIMUM_AREA", "MINIMUM_CELLS", "MINIMUM_CONFIDENCE", "BRIDGED_GAP", "SEVERITY_MODERATE", "SEVERITY_HIGH"]
MOVEMENT = ["MOVEMENT", "MOVEMENT_CONFIDENCE"]
HEATMAP = ["TOP_VIEW_PIXEL", "OPACITY", "COLOUR_RANGE"]
ROAD = [
    "CENTRELINE", "FIELD_NAMES", "CENTRELINE_LAYER", "ROUTE_NAME", "CHAINAGE_START", "CHAINAGE_DIRECTION",
    "CHAINAGE_UNIT", "CHAINAGE_EQUATIONS", "CHAINAGE_STYLE", "ROAD_REACH", "ROAD_TOLERANCE",
]  # fmt: skip
ASSETS = ["CLASSES", "CLASS_FIELD"]
REPORT = ["PROFILES", "ZONE_PROFILES", "PROFILE_FIELD"]
DETAILS = [
    "PDF", "SLOPE_NAME", "REPORT_ROUTE", "CHAINAGE_RANGE", "CLIENT", "AUTHOR", "CHECKER", "UAV", "SENSOR",
    "FLYING_HEIGHT", "FLIGHT_DATES", "WEATHER", "REPORT_REMARKS", "ACTIONS",
]  # fmt: skip
SCREENING = [
    "SCREENING_METHOD", "GROUND", "WEIGHTS", "ROTATIONS", "RESIDUAL_THRESHOLD", "MINIMUM_PROBABILITY",
    "MINIMUM_HAZARD_AREA", "PROBABILITY_CELL", "FALSE_ZONES", "WRITE_CLASSIFICATION", "MINIMUM_DIP", "MAXIMUM_DIP",
    "ANY_DENSITY", "ANY_RELIEF", "SELF_TEST", "DEVICE", "THREADS",
]  # fmt: skip
PRODUCTS = [
    "OUTPUT_FOLDER", "ELEVATION_CHANGE", "LEVEL_OF_DETECTION", "CHANGE_PROBABILITY", "CELL_SIZE", "SIGNIFICANT_CHANGE",
    "PLANT_ERROR", "PLANT_CHANGE", "ZONES", "FOOTPRINTS", "UNSURE", "HEATMAP", "TOP_VIEW", "SURFACE_HEIGHTS",
    "POINT_COUNTS", "CLASS_BUDGET", "SEEN", "NOT_SEEN", "OBJECTS",
]  # fmt: skip
MODEL_PRODUCTS = [
    "OUTPUT_FOLDER", "ELEVATION_CHANGE", "LEVEL_OF_DETECTION", "SIGNIFICANT_CHANGE", "ZONES", "FOOTPRINTS", "UNSURE",
    "NOT_SEEN", "HEATMAP", "TOP_VIEW", "SURFACE_HEIGHTS", "SIGNIFICANCE", "RATE", "CLASS_BUDGET",
    "SEEN",
]  # fmt: skip
DISPLACEMENT = [
    "WINDOW", "WIDE_WINDOW", "SPACING", "LARGEST_MOTION", "VECTOR_CONFIDENCE", "SLIDE_AREA", "SURFACE_ERROR",
    "SUBTRACT",
]  # fmt: skip
MOTION = ["VECTORS", "MOVING_ZONES", "ONE_DIRECTION", "DISPLACEMENT_RASTER", "SMALLEST_MOTION"]
PLANTS = ["GRASS", "GRASS_HEIGHT", "MOWN", "FERNS", "FOREST", "LAYOUT", "LITTER", "MULTIPATH", "STRAY"]
OUTPUT = ["OVERWRITE"]
FLIGHT_PRODUCTS = [
    "WAYPOINTS", "LINES", "EXPECTED_LEVEL", "EXPECTED_GROUND", "EXPECTED_RETURNS", "EXPECTED_MOTION",
]  # fmt: skip
TOP_VIEW = ["TOP_VIEW", "HILLSHADE_RASTER", "DENSITY", "GROUND_DENSITY", "CANOPY_HEIGHT"]
SCREENED = ["SCREENED_ZONES", "SCREENED_PROBABILITY", "SCREENED_SMALLEST_HAZARD"]
SERIES_MOTION = ["MOTION_VECTORS", "MOTION_STEPS", "MOTION_VELOCITIES", "MOVING_ZONES", "MOTION", "SMALLEST_MOTION"]
FROZEN_PARAMETERS = {
    "inspectslope": [
        "REFERENCE", "REFERENCE_DATE", "CLOUD", "CLOUD_DATE", "ROI", "PROFILE", "STABLE", "CORRECTIONS", "GROUND",
        *GROUND, *REGISTRATION, *CHANGE, *ZONES, *MOVEMENT, *HEATMAP, *REPORT, *DETAILS, *INPUT, *PRODUCTS, *ROAD,
        *ASSETS, "DISPLACEMENT", *DISPLACEMENT, *MOTION,
        "SCREEN_LAST_EPOCH", *(name for name in SCREENING if name != "GROUND"), *SCREENED, *OUTPUT,
    ],
    "inspectseries": [
        "INPUT", "MANIFEST", "ROI", "ALERTS", "PROFILE", "GROUND_READY", "RASTERS_EACH_SURVEY", "STABLE",
        "CORRECTIONS", "LOAD_RASTERS", "GROUND", *GROUND, *REGISTRATION, *ONE_SIZE, *ZONES, "DISPLACEMENT", *DETAILS,
        *INPUT, *OUTPUT,
        *ROAD, *ASSETS, "OUTPUT_FOLDER", "ZONES", "SERIES", "VELOCITY", "VELOCITY_ERROR", "EPOCHS_CONFIRMED",
        "CLASS_BUDGET", *SERIES_MOTION,
    ],
    "corridorbatch": [
        "MANIFEST", "INPUT", "CENTRELINE", "ALERT_TABLE", "PROFILE", "WORKERS", "MEMORY_BUDGET", "TWO_SURVEYS",
        "RETRIES", "RETRY_FAILED", "CHAINAGE_START", "SCHEDULER", "DASHBOARD", "DASHBOARD_ADDRESS", "GROUND_READY",
        "RASTERS_EACH_SURVEY", "CORRECTIONS", "GROUND", *GROUND, *REGISTRATION, *CHANGE, *ZONES, *MOVEMENT, *HEATMAP,
        *(name for name in REPORT if name != "PROFILES"), *DETAILS, "DISPLACEMENT", *DISPLACEMENT, "SCREEN_LAST_EPOCH",
        *(name for name in SCREENING if name != "GROUND"), *INPUT, *OUTPUT, *ROAD, *ASSETS,
        "OUTPUT_FOLDER", "ZONES", "ALERTS", "SLOPES",
    ],
    "screenhazards": [
        "INPUT", "ROI", "PROFILE", *SCREENING, *GROUND, *INPUT, *ROAD, "OUTPUT", "ZONES", "PROBABILITY",
        "SMALLEST_HAZARD", "MAP",
    ],
    "extractground": ["INPUT", "ROI", "PROFILE", *GROUND, *INPUT, "OUTPUT"],
    "registerepochs": ["REFERENCE", "CLOUD", "STABLE", "PROFILE", *REGISTRATION, *INPUT, "OUTPUT", "TRANSFORM"],
    "elevationchange": [
        "REFERENCE", "REFERENCE_DATE", "CLOUD", "CLOUD_DATE", "TRANSFORM", "STABLE", "PROFILE",
        *CHANGE, *ZONES, *MOVEMENT, *HEATMAP, *REPORT, *DETAILS, *INPUT, *PRODUCTS, *OUTPUT, *ROAD, *ASSETS,
    ],
    "writereport": ["INPUT", "PROFILES", "PHOTOS", *REPORT[1:], *DETAILS],
    "locateonroad": ["INPUT", *ROAD, "OUTPUT", *OUTPUT],
    "m3c2distances": [
        "REFERENCE", "REFERENCE_DATE", "CLOUD", "CLOUD_DATE", "CORE", "ROI", "TRANSFORM", "STABLE",
        "NORMAL_SCALE", "PROJECTION_SCALE", "HALF_LENGTH", "CORE_SPACING", "DISTANCE_CELL", "NORMALS", "ORIENTATION",
        "MINIMUM_CYLINDER_POINTS", "CONFIDENCE", "REGISTRATION_ERROR", "CALIBRATE", *INPUT, *DETAILS,
        "OUTPUT", "DISTANCE", "LEVEL_OF_DETECTION", "SIGNIFICANT", "ZONES", "FOOTPRINTS", "UNSURE",
    ],
    "displacementvectors": [
        "REFERENCE", "REFERENCE_DATE", "CLOUD", "CLOUD_DATE", "TRANSFORM", "STABLE", *DISPLACEMENT,
        "MEMORY_LIMIT", *INPUT, *ROAD, "OUTPUT_FOLDER", "VECTORS", "MOVING_ZONES",
        "ONE_DIRECTION", "DISPLACEMENT", "SMALLEST_MOTION", *OUTPUT,
    ],
    "demchange": [
        "MODELS", "MODEL_DATES", "STABLE", "CELL", "CONFIDENCE", "PLAN_SHIFT", "TILT", "STATISTICS_ONLY",
        "MAXIMUM_BIAS",
        *ZONES, *HEATMAP, *REPORT, *DETAILS, *INPUT, *MODEL_PRODUCTS, *OUTPUT, *ROAD, *ASSETS,
    ],
    "simulatesurvey": [
        "SEED", "POINTS", "LENGTH", "HEIGHT", "ANGLE", "BENCHES", "VEGETATION", "RANGE_NOISE", "OFFSET", "AMPLITUDE",
        *PLANTS, "OUTPUT_FOLDER", "ROI", "TRUTH_DZ", "TRUTH_MOTION", "TRUTH_ZONES", *OUTPUT,
    ],
    "simulateseries": [
        "SEED", "POINTS", "LENGTH", "HEIGHT", "ANGLE", "BENCHES", "VEGETATION", "RANGE_NOISE", "OFFSET", *PLANTS,
        "SURVEYS", "INTERVAL", "VELOCITIES", "ONSET", "GROUND_ONLY", "OUTPUT_FOLDER", "ROI", "TRUTH_VELOCITY", *OUTPUT,
    ],
    "simulatescenes": ["KIND", "COUNT", "SEED", "AREA", "DENSITY", "BENCHMARK", "PICTURE", "OUTPUT_FOLDER", *OUTPUT],
    "trainmodel": [
        "CLOUDS", "POLYGONS", "START", "DIMENSION", "CLASSES", "CLASS_FIELD", "OUTSIDE", "STEPS", "MINUTES", "FOLDS",
        "LEARNING_RATE", "BATCH", "NETWORK", "SEED", "DEVICE", "THREADS", "CRS", "HEIGHT_UNIT", "START_WEIGHTS",
        "OUTPUT_FOLDER", *OUTPUT,
    ],
    "setupengine": ["SCREENING", "REPAIR", "WHEELS", "PYTHON"],
    "topview": [
        "INPUT", "ROI", "CELL", "HILLSHADE", "GROUND_RETURNS", "VIEW_MEMORY", *INPUT, *OUTPUT, "OUTPUT_FOLDER",
        *TOP_VIEW,
    ],
    "suggestroi": [
        "INPUT", "REGION_CELL", "LEAST_DENSITY", "LARGEST_HOLE", "SPIKE_WIDTH", "SMALLEST_PART", "SIMPLIFICATION",
        *INPUT, *OUTPUT, "OUTPUT",
    ],
    "exportgis": [
        "INPUT", "FIELDS", "TO", "FORMATS", "EACH_SLOPE", "SURFACE_POINTS", "METADATA_TITLE", "ORGANISATION", "EMAIL",
        "LICENCE", "SCHEMA", "SRID", *OUTPUT, "OUTPUT",
    ],
    "createproject": ["INPUT", "PROJECT_TITLE", "AUTHOR", "PAPER", *OUTPUT, "OUTPUT"],
    "planflight": [
        "TERRAIN", "ROI", "SURVEY", "ALTITUDE", "FLYING_SPEED", "FIELD_OF_VIEW", "SIDE_OVERLAP", "PULSE_RATE",
        "SCAN_PATTERN", "AZIMUTH", "MARGIN", "CLIMB_RATE", "HEIGHT_TOLERANCE", "CLEARANCE", "BRIDGED_TERRAIN",
        "TURN_TIME", "BATTERY_TIME", "GROUND_SHARE", "GROUND_SCATTER", "EXPECTED_REGISTRATION_ERROR",
        "EXPECTED_CONFIDENCE", "MOTION_WINDOW", "PLACE_SIZE", "WPML_DRONE", "WPML_PAYLOAD", "WPML_PAYLOAD_POSITION",
        "TAKEOFF_HEIGHT", "TAKEOFF_ELLIPSOID_HEIGHT", *INPUT, *OUTPUT, "SEASON", "PLAN", "OUTPUT_FOLDER",
        *FLIGHT_PRODUCTS,
    ],
    "compareflight": ["PLAN", "INPUT", "GROUND", "TRAJECTORY", *INPUT, *OUTPUT, "OUTPUT_FOLDER", "PLACES"],
    "exportlabelstudio": [
        "PICTURE", "SEGMENTS", "LABELS", "LABEL_FIELD", "PICTURE_ADDRESS", "LARGEST_PICTURE", *OUTPUT, "OUTPUT_FOLDER",
    ],
    "importlabelstudio": ["EXPORT", "TASKS", *OUTPUT, "OUTPUT"],
    "cloudinfo": ["INPUT", *INPUT],
    "checkenvironment": [],
}  # fmt: skip
FROZEN_GROUPS = {
    "inspectslope": "inspection",
    "inspectseries": "inspection",
    "corridorbatch": "inspection",
    "screenhazards": "inspection",
    "extractground": "steps",
    "registerepochs": "steps",
    "elevationchange": "steps",
    "writereport": "steps",
    "locateonroad": "steps",
    "m3c2distances": "steps",
    "displacementvectors": "steps",
    "demchange": "steps",
    "simulatesurvey": "tools",
    "simulateseries": "tools",
    "simulatescenes": "tools",
    "trainmodel": "tools",
    "setupengine": "tools",
    "topview": "tools",
    "suggestroi": "tools",
    "exportgis": "tools",
    "createproject": "tools",
    "planflight": "tools",
    "compareflight": "tools",
    "exportlabelstudio": "tools",
    "importlabelstudio": "tools",
    "cloudinfo": "tools",
    "checkenvironment": "tools",
}
CHANGE_OUTPUTS = [
    "ZONE_COUNT", "ZONE_AREA", "LOSS", "GAIN", "LOSS_ERROR", "GAIN_ERROR", "LARGEST_SINK", "LARGEST_RISE",
    "COMPARED_SHARE", "COMMON_CELL_RATE", "LEVEL_MEDIAN",
    "REPORT", "REPORT_PDF", "VOLUMES", "CLASS_TABLE", "HEATMAP_PICTURE", "RUN_RECORD", *PRODUCTS,
]  # fmt: skip
REGISTRATION_OUTPUTS = ["SHIFT_X", "SHIFT_Y", "SHIFT_Z", "STABLE_SHARE", "REGISTRATION_STANDARD_ERROR"]
FROZEN_OUTPUTS = {
    "inspectslope": [
        *CHANGE_OUTPUTS, *REGISTRATION_OUTPUTS, "TRANSFORM_FILE", "REFERENCE_GROUND", "REGISTERED_GROUND",
        *MOTION, "MOVING_ZONE_COUNT", "FASTEST_ZONE",
        *SCREENED, "SCREENED_ZONE_COUNT", "CONFIRMED_ZONES", "SCREENED_CLOUD", "SCREENED_MAP",
    ],
    "inspectseries": [
        "EPOCH_COUNT", "ZONE_COUNT", "CONFIRMED_ZONES", "HIGHEST_ALERT", "ALERTED_ZONES", "FASTEST_RATE",
        "DETECTABLE_RATE", "LEVEL_MEDIAN", "REPORT", "REPORT_PDF", "TABLE", "CLASS_TABLE", "PICTURE", "ALERTS_USED",
        "RUN_RECORD", "CUMULATIVE", "INCREMENTAL", "OUTPUT_FOLDER", "ZONES", "SERIES", "VELOCITY", "VELOCITY_ERROR",
        "EPOCHS_CONFIRMED", "CLASS_BUDGET", "MOVING_ZONE_COUNT", "FASTEST_MOTION", *SERIES_MOTION,
    ],
    "corridorbatch": [
        "SLOPE_COUNT", "SLOPES_DONE", "SLOPES_COMPUTED", "SLOPES_FAILED", "ZONE_COUNT", "OPEN_ALERTS",
        "HIGHEST_ATTENTION", "PAGE", "PAGE_PDF", "CORRIDOR", "PARQUET", "MOSAIC", "CLOUDS", "RUN_RECORD",
        "OUTPUT_FOLDER", "ZONES", "ALERTS", "SLOPES",
    ],
    "screenhazards": [
        "ZONE_COUNT", "ZONE_AREA", "UPLIFT_ZONES", "SUBSIDENCE_ZONES", "GROUND_POINTS", "DENSITY", "DIP", "RUN_RECORD",
        "OUTPUT", "ZONES", "PROBABILITY", "SMALLEST_HAZARD", "MAP",
    ],
    "extractground": [
        "RAW_POINTS", "RAW_AREA", "RAW_DENSITY", "ROI_POINTS", "ROI_AREA", "ROI_DENSITY", "GROUND_POINTS",
        "GROUND_RATIO", "VEGETATION_COVER", "RUN_RECORD", "OUTPUT",
    ],
    "registerepochs": [*REGISTRATION_OUTPUTS, "RMSE_BEFORE", "RMSE_AFTER", "INLIER_RMSE", "OUTPUT", "TRANSFORM"],
    "elevationchange": CHANGE_OUTPUTS,
    "writereport": ["REPORT", "REPORT_PDF", "PROFILE_LINES", "PROFILE_TABLE"],
    "locateonroad": ["FEATURES", "LOCATED", "NOT_LOCATED", "RUN_RECORD", "OUTPUT"],
    "m3c2distances": [
        "CORE_POINTS", "MEASURED_POINTS", "SIGNIFICANT_POINTS", "LARGEST_LOWERING", "LARGEST_RAISING", "LEVEL_MEDIAN",
        "NORMAL_SCALE_USED", "PROJECTION_SCALE_USED", "HALF_LENGTH_USED", "RUN_RECORD", "OUTPUT", "DISTANCE",
        "LEVEL_OF_DETECTION", "SIGNIFICANT", "ZONES", "FOOTPRINTS", "UNSURE", "ZONE_COUNT", "VOLUME_LOST",
        "VOLUME_GAINED", "REPORT", "REPORT_PDF", "VOLUMES", "FACE_PICTURE",
    ],
    "displacementvectors": [
        "ZONE_COUNT", "ZONE_AREA", "FASTEST_ZONE", "VECTOR_COUNT", "MEASURED_SHARE", "SMALLEST_MEDIAN", "REPORT",
        "RUN_RECORD", "OUTPUT_FOLDER", "VECTORS", "MOVING_ZONES", "ONE_DIRECTION", "DISPLACEMENT", "SMALLEST_MOTION",
    ],
    "demchange": [
        "MODEL_COUNT", "BIAS", "BIAS_ERROR", "SHIFT_EAST", "SHIFT_NORTH",
        "TILT_SIZE", "TILT_ERROR", "BEND_SIZE", "BEND_ERROR",
        "ZONE_COUNT", "ZONE_AREA", "LOSS", "GAIN", "LOSS_ERROR", "GAIN_ERROR", "LARGEST_SINK", "LARGEST_RISE",
        "COMPARED_SHARE", "LEVEL_MEDIAN", "REPORT", "REPORT_PDF", "VOLUMES", "CLASS_TABLE", "HEATMAP_PICTURE",
        "RUN_RECORD", "PAIRS", "ZONE_SERIES",
        *MODEL_PRODUCTS,
    ],
    "simulatesurvey": [
        "REFERENCE", "CLOUD", "TRUTH", "TRUTH_TRANSFORM", "RUN_RECORD", "OUTPUT_FOLDER", "ROI", "TRUTH_DZ",
        "TRUTH_MOTION", "TRUTH_ZONES",
    ],
    "simulateseries": ["MANIFEST", "TRUTH", "RUN_RECORD", "OUTPUT_FOLDER", "ROI", "TRUTH_VELOCITY"],
    "simulatescenes": [
        "SCENE", "HAZARDS", "MANIFEST", "PICTURE_FILE", "RUN_RECORD", "SCENES", "POINTS", "HAZARD_COUNT",
        "SHARE_BACKGROUND", "SHARE_UPLIFT", "SHARE_SUBSIDENCE", "OUTPUT_FOLDER",
    ],
    "trainmodel": [
        "WEIGHTS", "DESCRIPTION", "LOG", "REPORT", "RUN_RECORD", "LABELLED_POINTS", "FOLD_COUNT", "STEPS_DONE",
        "OVERALL_ACCURACY", "MEAN_IOU", "MAJORITY_ACCURACY", "START_MEAN_IOU", "HAZARD_RECALL",
        "START_HAZARD_RECALL", "FALSE_ZONES_RATE", "START_FALSE_ZONES_RATE", "CALIBRATION_SCALE", "CALIBRATION_SHIFT",
        "TEMPERATURE", "OUTPUT_FOLDER",
    ],
    "setupengine": ["ENGINE", "PYTHON_VERSION", "FOLDER", "SCREENING_READY"],
    "topview": [
        "POINTS", "CELL_USED", "AREA", "MEDIAN_DENSITY", "MEDIAN_GROUND_DENSITY", "RUN_RECORD", "OUTPUT_FOLDER",
        *TOP_VIEW,
    ],
    "suggestroi": ["PARTS", "AREA", "AREA_SHARE", "POINTS_SHARE", "DENSITY", "RUN_RECORD", "OUTPUT"],
    "exportgis": ["FILES", "LAYERS", "DATABASE_ZONES", "DATABASE_EVENTS", "RUN_RECORD", "OUTPUT"],
    "createproject": ["LAYERS", "LAYOUT", "OUTPUT"],
    "planflight": [
        "LINE_COUNT", "LINE_LENGTH", "FLIGHT_TIME", "BATTERIES", "GROUND_DENSITY", "LEVEL", "MOTION", "KML", "PICTURE",
        "RUN_RECORD", "OUTPUT_FOLDER", *FLIGHT_PRODUCTS,
    ],
    "compareflight": [
        "LINES_PLANNED", "LINES_FLOWN", "COVERED_SHARE", "RETURNS_RATIO", "GROUND_RATIO", "SHORT_PLACES", "COMPARISON",
        "STRIPS_TABLE", "RUN_RECORD", "OUTPUT_FOLDER", "PLACES",
    ],
    "exportlabelstudio": ["PICTURES", "REGIONS", "TASKS", "LABELS_FILE", "RUN_RECORD", "OUTPUT_FOLDER"],
    "importlabelstudio": ["REGIONS", "POLYGONS", "AREA", "RUN_RECORD", "OUTPUT"],
    "cloudinfo": ["POINTS", "AREA", "DENSITY", "REFERENCE_SYSTEM", "UNUSUAL"],
    "checkenvironment": ["ENGINE", "PDAL", "VERSION"],
}  # fmt: skip
COMMANDS = {
    "inspectslope": ["inspect"],
    "inspectseries": ["series"],
    "corridorbatch": ["batch"],
    "screenhazards": ["screen"],
    "extractground": ["ground"],
    "registerepochs": ["register"],
    "elevationchange": ["change"],
    "writereport": ["report"],
    "locateonroad": ["locate"],
    "m3c2distances": ["m3c2"],
    "displacementvectors": ["displacement"],
    "demchange": ["demchange"],
    "simulatesurvey": ["simulate", "survey"],
    "simulateseries": ["simulate", "series"],
    "simulatescenes": ["simulate", "scenes"],
    "trainmodel": ["train"],
    "setupengine": ["check"],  # it runs no other command
    "topview": ["topview"],
    "suggestroi": ["suggestroi"],
    "exportgis": ["exportgis"],
    "createproject": ["createproject"],
    "planflight": ["planflight"],
    "compareflight": ["compareflight"],
    "exportlabelstudio": ["exportlabelstudio"],
    "importlabelstudio": ["importlabelstudio"],
    "cloudinfo": ["info"],
    "checkenvironment": ["check"],
}

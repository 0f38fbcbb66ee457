"""Every parameter, once: name, unit, default, range. YAML in, YAML out; an unknown key is an error."""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gapeval.errors import ConfigError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Angle = Annotated[float, Field(gt=-math.pi / 2, lt=math.pi / 2)]
Vector = tuple[Finite, Finite, Finite]
Quaternion = tuple[Finite, Finite, Finite, Finite]
Interval = tuple[Finite, Finite]


class Section(BaseModel):
    """Docstrings of fields are their descriptions; docs/configuration.md is made from them."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, ser_json_inf_nan="strings", use_attribute_docstrings=True
    )


class Patch(Section):
    """The fixed area in front of the robot of Section 3.1.1, for `plane: patch`."""

    depth: Positive = 1.0
    """m, from x_min forwards"""
    width: Positive = 1.0
    """m, centred on the robot"""
    max_tilt: Annotated[float, Field(gt=0, lt=math.pi / 2)] = 0.26
    """rad, against the robot's xy plane"""
    max_offset: Positive = 0.3
    """m, against ground_z, at the middle of the patch"""
    min_points: Annotated[int, Field(ge=3)] = 50
    """points that the patch must have"""


class Detector(Section):
    """Section 3.1 and Table II."""

    k: Annotated[int, Field(ge=1, le=12)] = 6
    """resolution: i_height = i_width = 2**k + 1, where those are not given"""
    i_height: Annotated[int, Field(ge=2, le=4097)] | None = None
    """resolution in r, instead of k"""
    i_width: Annotated[int, Field(ge=2, le=4097)] | None = None
    """resolution in theta, instead of k"""
    delta_r: Annotated[float, Field(gt=1, le=1000)] = 1.1
    """growth of the intervals in r from row to row"""
    n_o: Annotated[int, Field(ge=0, le=50)] = 1
    """number of erosions, and of dilations"""
    pl_th: Positive = 0.1
    """m, plane threshold: ground is at most this far from the plane"""
    x_min: NotNegative = 0.6
    """m, where the sensory box begins, in the robot frame"""
    r_max: Positive = 3.0
    """m, where the box ends, from the origin of the grid; the paper's R"""
    z_min: Annotated[float, Field(gt=0)] = math.inf
    """m, points lower than this below the robot frame's origin are dropped"""
    z_max: Positive = 2.0
    """m, points higher than this above the robot frame's origin are dropped"""
    origin: Literal["sensor", "robot"] = "sensor"
    """where the polar grid is centred; see detector.md"""
    plane: Literal["robot", "patch", "gravity"] = "robot"
    """supporting plane: z = robot.ground_z, fitted to a patch in front of the robot, or level"""
    patch: Patch = Patch()
    edge: Literal["data", "zero"] = "data"
    """what lies beyond the box when the image is opened: what the cloud says, or no gap; see detector.md"""
    kernel: Literal["rect", "cross"] = "rect"
    """3 x 3 element of the erosions and dilations; see detector.md"""

    @property
    def height(self) -> int:
        """The paper's I_height."""
        return self.i_height if self.i_height is not None else 2**self.k + 1

    @property
    def width(self) -> int:
        """The paper's I_width."""
        return self.i_width if self.i_width is not None else 2**self.k + 1

    @model_validator(mode="after")
    def box_is_not_empty(self) -> Self:
        if self.x_min >= self.r_max:
            raise ValueError(f"x_min {self.x_min} leaves nothing of r_max {self.r_max}")
        return self


class CrossingRules(Section):
    """Section 3.2: when may the robot cross, and from where to where?"""

    d_r: Positive | None = None
    """m, longest gap that can be crossed; default: half the robot's length"""
    standoff: NotNegative | None = None
    """m, START and END lie this far before and behind the gap; default: half the robot's length"""
    eta: Positive | None = None
    """m, the paper's START, END = centre -+ eta e, instead of the standoff"""
    clearance: NotNegative | None = None
    """m, to be kept free around START and END; default: half the robot's width"""
    uniform: Literal["area", "kdtree"] = "area"
    """how the interior gets a uniform density: exact area moments, or the paper's tree; see detector.md"""
    rules: Literal["all", "paper"] = "all"
    """whether the reasons `clipped` and `unobserved`, which are ours, apply too"""
    min_observed: Share = 0.5
    """share of the footprint at START and END that must lie on observed ground"""


class BodyBox(Section):
    """The robot's own body in its own frame; points in it are dropped."""

    x: Interval
    """m, [low, high]"""
    y: Interval
    """m, [low, high]"""
    z: Interval
    """m, [low, high]"""

    @model_validator(mode="after")
    def intervals_are_ordered(self) -> Self:
        for name in "xyz":
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name} must be [low, high], not [{low}, {high}]")
        return self


class Robot(Section):
    """The robot."""

    length: Positive = 0.68
    """m"""
    width: Positive = 0.5
    """m"""
    ground_z: Finite = 0.0
    """m, height of the ground in the robot frame"""
    body: BodyBox | None = None


@dataclass(frozen=True, slots=True)
class Limits:
    """Distances [m] of the crossing rules, with the robot's own size for what they leave open."""

    d_r: float
    standoff: float
    clearance: float


def limits(rules: CrossingRules, robot: Robot) -> Limits:
    """d_r is about what a body crosses: half its length."""
    return Limits(
        d_r=robot.length / 2 if rules.d_r is None else rules.d_r,
        standoff=robot.length / 2 if rules.standoff is None else rules.standoff,
        clearance=robot.width / 2 if rules.clearance is None else rules.clearance,
    )


class BlindBelow(Section):
    """A blind zone of one's own."""

    below: Annotated[float, Field(ge=-math.pi / 2, le=math.pi / 2)]
    """rad, lowest elevation that the sensor sees, in the sensor frame"""


class FieldOfView(Section):
    """What the sensor can see, in the sensor frame."""

    azimuth: Interval = (-math.pi, math.pi)
    """rad, [low, high]"""
    elevation: Interval = (-math.pi / 2, math.pi / 2)
    """rad, [low, high]"""

    @model_validator(mode="after")
    def intervals_are_ordered(self) -> Self:
        for name, (low, high), limit in (
            ("azimuth", self.azimuth, math.pi),
            ("elevation", self.elevation, math.pi / 2),
        ):
            if not -limit - 1e-3 <= low < high <= limit + 1e-3:
                raise ValueError(f"{name} must be [low, high] in radians within ±{limit:.4f}")
        return self


class Sensor(Section):
    """The sensor."""

    blind_zone: Literal["auto", "none"] | BlindBelow = "auto"
    """ground below the lowest ray is no gap: auto (measured in the log), none, or {below: rad}"""
    fov: FieldOfView | None = None


class StaticTransform(Section):
    """A transform parent<-child that the log lacks."""

    parent: str
    """frame"""
    child: str
    """frame"""
    translation: Vector = (0.0, 0.0, 0.0)
    """m, [x, y, z]"""
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """quaternion, [x, y, z, w]"""


class PoseError(Section):
    """A fixed error of the robot's pose: every frame's points are turned and lifted so in the robot frame."""

    roll: Angle = 0.0
    """rad, about x: the left side rises"""
    pitch: Angle = 0.0
    """rad, about y: the ground ahead sinks"""
    height: Finite = 0.0
    """m, upwards"""


class PoseNoise(Section):
    """An error that is drawn anew for each frame: standard deviations. Drawn by seed and stamp alone."""

    roll: NotNegative = 0.0
    """rad, about x"""
    pitch: NotNegative = 0.0
    """rad, about y"""
    height: NotNegative = 0.0
    """m"""
    seed: Annotated[int, Field(ge=0)] = 0
    """of the draws; logs with equal stamps have equal errors by equal seeds"""


class Accumulate(Section):
    """Scans gathered in the fixed frame to one cloud, at each scan: it and those before it."""

    scans: Annotated[int, Field(ge=1)] | None = None
    """how many scans"""
    seconds: Positive | None = None
    """s, how long before the scan, instead"""

    @model_validator(mode="after")
    def one_is_given(self) -> Self:
        if (self.scans is None) == (self.seconds is None):
            raise ValueError("give either scans or seconds")
        return self


class RotatingLaser(Section):
    """Planar scans of a laser that turns, gathered to a cloud for each pass; see logs.md."""

    time_increment: NotNegative | None = None
    """s from beam to beam, in place of the scans' own"""
    range: Interval | None = None
    """m, [low, high]: echoes outside are dropped, beside those outside the scans' own limits"""
    shadow_filter: Annotated[float, Field(ge=0, lt=math.pi / 2)] = 0.0
    """rad; neighbouring echoes are dropped whose line meets a beam at less than this; 0: none"""
    echo: Literal["first", "last", "strongest"] = "first"
    """of MultiEchoLaserScan"""

    @model_validator(mode="after")
    def range_is_ordered(self) -> Self:
        if self.range is not None and not 0 <= self.range[0] < self.range[1]:
            raise ValueError(f"range must be [low, high] from 0 on, not {list(self.range)}")
        return self


class LogSection(Section):
    """How a log is read; see logs.md."""

    cloud_topic: str | None = None
    """topic of the clouds or planar scans; default: the only one"""
    cloud_topics: tuple[str, ...] = ()
    """topics of several lasers to merge: a cloud for each of the first's, with the nearest of the others"""
    accumulate: Accumulate | None = None
    deskew: bool = False
    """move each point by the time it was measured at to where it is at the cloud's stamp"""
    laser: RotatingLaser = RotatingLaser()
    start: NotNegative | None = None
    """s from the log's beginning; earlier clouds are left out"""
    end: NotNegative | None = None
    """s from the log's beginning; later clouds are left out"""
    every: Annotated[int, Field(ge=1)] = 1
    """only each so manieth cloud"""
    strict: bool = False
    """whether a log that cannot be read whole is an error"""
    poses: str | None = None
    """file of poses of the robot frame, TUM or KITTI, in place of those in the log"""
    imu_topic: str | None = None
    """sensor_msgs/Imu that tells where down is, where there is no full pose; default: the only one"""
    pose_topic: str | None = None
    """odometry or pose topic to use instead of tf"""
    robot_frame: str | None = None
    """frame of the robot; default: base_link"""
    fixed_frame: str | None = None
    """frame that stands still; default: map, odom or world"""
    sensor_frame: str | None = None
    """frame of the laser; default: that of the clouds"""
    transforms: tuple[StaticTransform, ...] = ()
    """static transforms that the log lacks"""
    max_tf_gap: Positive = 0.5
    """s, longest time between two transforms that are interpolated"""
    stamps: Literal["header", "bag"] = "header"
    """a cloud's time: its header's stamp, or when it was recorded"""
    min_matched: Share = 0.5
    """share of the clouds that must have all their transforms"""
    pose_error: PoseError | None = None
    """what a pose that is always wrong would do; see simulation.md"""
    pose_noise: PoseNoise | None = None
    """what poses that are wrong by chance would do; see simulation.md"""
    lowest_elevation: dict[str, float] = {}
    """rad, the sensor's lowest ray by file name; measured where absent, and written to config.yaml"""

    @model_validator(mode="after")
    def end_is_not_before_start(self) -> Self:
        if self.start is not None and self.end is not None and self.end < self.start:
            raise ValueError(f"end {self.end:g} is before start {self.start:g}")
        return self


class Domain(Section):
    """Where detections are compared with labels: the box of Section 3.1.1."""

    x_min: NotNegative
    """m, in the robot frame"""
    r_max: Positive
    """m, from the origin of the grid"""


class MinVisible(Section):
    """A label is asked for when this share of it, or this area, is visible, whichever is less."""

    share: Share = 0.5
    """of the label's area"""
    area: NotNegative = 0.5
    """m2"""


class Scoring(Section):
    """How gaps are compared with labels; see docs/scoring.md."""

    domain: Domain | None = None
    """where detections count; default: the largest box in the grid"""
    iou: Annotated[float, Field(gt=0, le=1)] = 0.5
    """least intersection over union of a matched pair"""
    hit_coverage: Annotated[float, Field(gt=0, le=1)] = 0.5
    """share of a visible label that must be covered for a hit; see scoring.md"""
    belongs: Annotated[float, Field(gt=0, le=1)] = 0.1
    """share of the smaller area that a gap and its label have in common"""
    min_visible: MinVisible = MinVisible()
    obstacle_height: Positive = 0.2
    """m above the plane; what is higher throws a shadow"""
    ceiling: Positive = 2.0
    """m above the plane; what is higher throws none"""
    block: Positive = 2.0
    """s, how long what a frame shows is like what the last one showed: of the intervals; see scoring.md"""


class Gate(Section):
    """Limits of `gapeval compare`; see docs/ci.md."""

    max_drop: dict[str, NotNegative | str] = {}
    """metric: how far it may fall, in its unit, or as a percentage such as 1%"""
    max_rise: dict[str, NotNegative | str] = {}
    """the same for metrics of which less is better, and for time and time.STAGE"""


class Configuration(Section):
    """One point of the grid: all that decides what is detected in a frame."""

    detector: Detector = Detector()
    crossing: CrossingRules = CrossingRules()
    robot: Robot = Robot()
    sensor: Sensor = Sensor()

    @property
    def parameters(self) -> dict[str, Any]:
        """The canonical parameters, as JSON values: i_height and i_width for k, and no distance left open."""
        values: dict[str, Any] = json.loads(self.model_dump_json())
        del values["detector"]["k"]
        values["detector"] |= {"i_height": self.detector.height, "i_width": self.detector.width}
        values["crossing"] |= asdict(limits(self.crossing, self.robot))
        return values

    @property
    def id(self) -> str:
        """12 hex digits over the canonical parameters."""
        text = json.dumps(self.parameters, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:12]


class Config(Section):
    """A configuration file: one value of everything, and a grid over any detector or crossing parameter."""

    grid: dict[str, list[Any]] = {}
    """parameter: [values]; every combination is evaluated"""
    detector: Detector = Detector()
    crossing: CrossingRules = CrossingRules()
    robot: Robot = Robot()
    sensor: Sensor = Sensor()
    log: LogSection = LogSection()
    scoring: Scoring = Scoring()
    compare: Gate = Gate()

    @property
    def base(self) -> Configuration:
        """The configuration without its grid."""
        return Configuration(
            detector=self.detector, crossing=self.crossing, robot=self.robot, sensor=self.sensor
        )

    def to_yaml(self, sections: Iterable[str] | None = None) -> str:
        """The whole, or only some sections of it."""
        include = None if sections is None else set(sections)
        values = self.model_dump(mode="json", exclude_none=True, include=include)
        # PyYAML writes a next-line character as it is, and reads it back as a space.
        text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
        return text if "\x85" not in text else yaml.safe_dump(values, sort_keys=False)


SWEPT = ("detector", "crossing")  # the sections that a grid may vary


def load_config(path: Path | None, assignments: Iterable[str] = (), **explicit: Any) -> Config:
    """The file's values, then `-p key=value` assignments, then explicit options (dotted with `__`).

    Raises ConfigError that names the file or option, the key and what would be right.
    """
    values: dict[str, Any] = {}
    source = "configuration"
    if path is not None:
        source = str(path)
        values = read_yaml(path)
        # The file by itself first, so that an error in it is not blamed on an option.
        _parse(values | {"grid": {}}, source)
    grid = values.get("grid") or {}
    if not isinstance(grid, dict):
        raise ConfigError(f"{source}: grid: expected `parameter: [values]`, found {type(grid).__name__}")
    grid = resolved_grid(grid, source)
    for text in assignments:
        key, choices = _parse_assignment(text)
        section, _, name = key.partition(".")
        if section in SWEPT and len(choices) > 1:
            grid[key] = choices
            continue
        if len(choices) != 1:
            raise ConfigError(f"-p {text}: {key} takes one value here; only detector and crossing are swept")
        grid.pop(key, None)
        _assign(values, section, name, choices[0])
    for option, value in explicit.items():
        if value is not None:
            section, _, name = option.partition("__")
            _assign(values, section, name, value)
    values["grid"] = grid
    return _parse(values, source if not assignments else f"{source} with -p")


def dotted_key(name: str) -> str:
    """The full key of a parameter's name: `delta_r` -> `detector.delta_r`. Raises ConfigError."""
    if "." in name:
        section, _, rest = name.partition(".")
        if section in Config.model_fields and section != "grid" and _has_key(section, rest):
            return name
        raise ConfigError(f"{name}: no such parameter{_suggestion(name)}")
    homes = [f"{section}.{name}" for section in Config.model_fields if _has_key(section, name)]
    if len(homes) == 1:
        return homes[0]
    if homes:
        raise ConfigError(f"{name}: say which of {', '.join(homes)}")
    raise ConfigError(f"{name}: no such parameter{_suggestion(name)}")


def set_parameter(configuration: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """A copy of nested values in which the dotted key has another value."""
    head, _, rest = key.partition(".")
    inner = configuration.get(head)
    if rest:
        value = set_parameter(inner if isinstance(inner, Mapping) else {}, rest, value)
    return {**configuration, head: value}


def validation_message(error: ValidationError) -> str:
    """pydantic's findings in one line: `detector.delta_r: input should be greater than 1 (got 1.0)`."""
    findings = []
    for item in error.errors():
        where = ".".join(str(part) for part in item["loc"])
        what = item["msg"].removeprefix("Value error, ")
        if item["type"] == "extra_forbidden":
            findings.append(f"{where}: no such parameter{_suggestion(where)}")
        elif isinstance(item["input"], list) and "." in where and where.startswith(SWEPT):
            findings.append(f"{where}: takes one value (got {item['input']}); several go into `grid:`, or -p")
        elif isinstance(item["input"], dict | list):
            findings.append(f"{where}: {what}")
        else:
            findings.append(f"{where}: {what[0].lower()}{what[1:]} (got {item['input']!r})")
    return "; ".join(findings)


class _Loader(yaml.SafeLoader):
    """Refuses a key that is there twice, of which YAML would silently take the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for index, key in enumerate(keys):
            if key in keys[:index]:
                mark = node.value[index][0].start_mark
                raise yaml.constructor.ConstructorError(None, None, f"{key} is there twice", mark)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path) -> dict[str, Any]:
    """The sections of a YAML file. Raises ConfigError."""
    try:
        values = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: cannot be read: not text; a configuration is YAML") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        what = getattr(error, "problem", None) or "not YAML"
        raise ConfigError(f"{path}{line}: not valid YAML: {what}") from error
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: expected sections such as `detector:`, found {type(values).__name__}")
    return {str(key): ({} if value is None else value) for key, value in values.items()}


def _parse(values: Mapping[str, Any], source: str) -> Config:
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        raise ConfigError(f"{source}: {validation_message(error)}") from error


def resolved_grid(grid: Mapping[str, Any], source: str) -> dict[str, Any]:
    """The grid with dotted keys, each of a section that may be swept."""
    resolved: dict[str, Any] = {}
    for name, choices in grid.items():
        try:
            key = dotted_key(str(name))
        except ConfigError as error:
            raise ConfigError(f"{source}: grid.{error}") from error
        if not key.startswith(SWEPT):
            raise ConfigError(f"{source}: grid.{name}: only detector and crossing parameters can be swept")
        if key in resolved:
            raise ConfigError(f"{source}: grid.{name}: given twice")
        if choices is None or choices == []:
            raise ConfigError(f"{source}: grid.{name}: no values; give at least one, or leave the key out")
        resolved[key] = choices if isinstance(choices, list) else [choices]
    return resolved


def _parse_assignment(text: str) -> tuple[str, list[Any]]:
    name, equals, right = text.partition("=")
    if not equals or not name.strip():
        raise ConfigError(f"-p {text}: expected key=value or key=value1,value2")
    try:
        choices = yaml.safe_load(f"[{right}]")
    except yaml.YAMLError as error:
        raise ConfigError(f"-p {text}: cannot read the value {right!r}") from error
    if not choices:
        raise ConfigError(f"-p {text}: no value")
    try:
        return dotted_key(name.strip()), choices
    except ConfigError as error:
        raise ConfigError(f"-p {error}") from error


def _assign(values: dict[str, Any], section: str, name: str, value: Any) -> None:
    values[section] = set_parameter(dict(values.get(section) or {}), name, value)


def _nested_models(model: type[BaseModel], name: str) -> list[type[BaseModel]]:
    annotation = model.model_fields[name].annotation
    candidates = [annotation, *getattr(annotation, "__args__", ())]
    return [c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)]


def _has_key(section: str, name: str) -> bool:
    models = _nested_models(Config, section)
    *path, leaf = name.split(".")
    for part in path:
        models = [n for model in models if part in model.model_fields for n in _nested_models(model, part)]
    return any(leaf in model.model_fields for model in models)


def _suggestion(name: str) -> str:
    import difflib

    known = {
        key: f"{section}.{key}"
        for section in Config.model_fields
        for model in _nested_models(Config, section)
        for key in model.model_fields
    }
    close = difflib.get_close_matches(name.rpartition(".")[2], known, n=1, cutoff=0.65)
    return f"; did you mean {known[close[0]]}?" if close else ""

"""The scenario of a transient run: muscles pull, and time passes."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from explicitfe.fem.inputs.limits import ElementName, StressField
from explicitfe.fem.inputs.material import Material
from explicitfe.fem.inputs.table import MOST_TABLES_OF_A_KIND, Name, Table, Threads, Title, Vector
from explicitfe.simulate.scenario.bodies import BodyTable, ContactTable, MeshTable
from explicitfe.simulate.scenario.bones import BoneTable, HyoidTable, JawTable
from explicitfe.simulate.scenario.effects_table import EffectsTable
from explicitfe.simulate.scenario.expected import EXPECTED, ExpectedNumbers
from explicitfe.simulate.scenario.lips import LipsTable
from explicitfe.simulate.scenario.loads import AirTable, InitialTable, LoadTable, PathOfNodesTable, ReleaseTable, SupportTable
from explicitfe.simulate.scenario.profile import ProfileTable
from explicitfe.simulate.scenario.surgery import GraftTable, ResectionTable, ScarTable

# The fields that a transient run stores, and those that it can store in addition.
UsualField = Literal["displacement", "velocity", "J", "hourglass_energy"]
FieldName = Literal[UsualField, StressField]


# So many pictures in time nobody looks at; of the smallest mesh they fill 10 GB.
MOST_SAMPLES = 1_000_000

FIELDS: tuple[UsualField, ...] = get_args(UsualField)


class Damping(Table):
    """Mass-proportional damping, and damping in proportion to the stiffness of the tissue's shear."""

    alpha_per_s: float = Field(default=0.0, ge=0.0, description="Rayleigh alpha [1/s]; 40 is usual for tongue models")
    beta_s: float = Field(
        default=0.0, ge=0.0, description="Rayleigh beta [s], by a Maxwell branch; 0.03 is usual for tongue models"
    )
    tau_ms: float = Field(default=5.0, gt=0.0, description="relaxation time of that branch [ms]: it damps below 1 / (2 pi tau)")


class ModelTable(MeshTable):
    """What is computed: a built-in model by name, or a mesh of one's own by its model file."""

    name: str | None = Field(default=None, description="a built-in model, see 'explicitfe list models'")
    material: Material = Field(default="gerard-2005", description="a name, see 'explicitfe list materials', or constants")
    materials: dict[Name, Material] = Field(
        default={}, description="element set of the mesh -> its material, of the law of material; a later set wins"
    )
    element: ElementName = Field(
        default="hex8",
        description="one point with assumed-strain hourglass control, one point with plain stiffness, or eight points",
    )
    barrier: bool = Field(
        default=True, description='whether a barrier keeps the corners of elements from folding; "hex8" alone has one'
    )
    damping: Damping = Damping()
    attachment: Literal["nodes", "area"] = Field(
        default="nodes",
        description='how bones hold the body: "nodes" stops the nodes of the sets in fixed, "area" ties the patches of these '
        "names by springs, in proportion to their area, whatever the mesh",
    )
    activation_stiffening: bool = Field(
        default=False,
        description="the tissue of muscles that pull is stiffer: its moduli times 1 + 9 times the sum of force / largest force, "
        "up to ten; for the whole run, at the force that force_N says",
    )
    gravity_m_s2: Vector = Field(default=(0.0, 0.0, 0.0), description="acceleration of gravity")
    speed: Literal["accurate", "interactive"] = Field(
        default="accurate",
        description="interactive: a Poisson's ratio of 0.49 at most, and 3 % of the mass added where elements are smallest, for "
        "steps that are several times as long",
    )

    _built_in_key = "name"


class MuscleTable(ProfileTable):
    """One muscle's pull."""

    name: Name = Field(description="see 'explicitfe list muscles'")
    force_N: float = Field(ge=0.0, description="force summed over all fibres of the sides named [N]")
    distribution: Literal["stress", "ends", "along", "volume"] = Field(
        default="ends", description="an active stress along the fibres in the tissue around them, or forces on nodes"
    )
    force_length: bool = Field(default=False, description='with "stress": whether it falls off in a shortened fibre')
    direction: Literal["reference", "following"] = Field(
        default="reference", description="of forces on nodes: as at rest, or along the fibres as they turn"
    )
    side: Literal["both", "left", "right"] = Field(default="both", description="which fibres pull")
    fibres: list[Annotated[int, Field(ge=1)]] | None = Field(
        default=None, min_length=1, description="numbers of the fibres that pull, counted from 1 on each side; all by default"
    )

    @model_validator(mode="after")
    def _distribution_fits(self) -> MuscleTable:
        if self.force_length and self.distribution != "stress":
            raise ValueError('force_length goes with distribution = "stress" only')
        if self.direction == "following" and self.distribution == "stress":
            raise ValueError('direction does not go with distribution = "stress": a stress along fibres follows them anyway')
        return self


class AnalysisTable(Table):
    """How it is computed."""

    type: Literal["transient"] = Field(default="transient", description="a transient run")
    duration_ms: float = Field(gt=0.0, description="simulated time [ms]")
    step_us: float | None = Field(
        default=None, gt=0.0, description="fixed time step [microseconds]; the largest stable step by default"
    )
    threads: Threads = None


class RecordTable(Table):
    """What is stored."""

    every_ms: float = Field(default=1.0, gt=0.0, description="time between two samples [ms]; at most a million samples")
    fields: list[FieldName] = Field(
        default=list(FIELDS),
        description="fields of nodes and elements stored at each sample; in addition to the default stress, von_mises, pressure, "
        "their means at nodes (nodal_...), strain and stretches",
    )
    probes: list[Name] | None = Field(default=None, description="named points with a history; all of the model by default")


class TransientScenario(Table):
    """One run, as its file states it."""

    title: Title
    question: str = Field(default="", description="question that the run answers")
    expect: str = Field(default="", description="expected result, in words")
    expected: list[ExpectedNumbers] = Field(default=[], max_length=MOST_TABLES_OF_A_KIND, description=EXPECTED)
    model: ModelTable
    body: list[BodyTable] = Field(default=[], max_length=MOST_TABLES_OF_A_KIND, description="further bodies, which it touches")
    contact: ContactTable | None = Field(
        default=None, description="contact of free surfaces of bodies; by default there is some where there are several"
    )
    load: list[LoadTable] = Field(
        default=[], max_length=MOST_TABLES_OF_A_KIND, description="forces on nodes, and masses that are fixed to them or hang"
    )
    support: list[SupportTable] = Field(
        default=[], max_length=MOST_TABLES_OF_A_KIND, description="elastic foundations in place of fixed nodes"
    )
    motion: list[PathOfNodesTable] = Field(
        default=[], max_length=MOST_TABLES_OF_A_KIND, description="node sets that move along a given path"
    )
    initial: list[InitialTable] = Field(
        default=[], max_length=MOST_TABLES_OF_A_KIND, description="velocities at time 0; a later table replaces an earlier one"
    )
    release: ReleaseTable | None = Field(default=None, description="how the body is held before it moves")
    air: AirTable | None = Field(default=None, description="drag of the air")
    muscle: list[MuscleTable] = Field(
        default=[],
        max_length=MOST_TABLES_OF_A_KIND,
        description="muscle forces; a muscle may be listed several times, and its forces add up",
    )
    bone: list[BoneTable] = Field(
        default=[], max_length=MOST_TABLES_OF_A_KIND, description="rigid surfaces that the body can touch"
    )
    jaw: JawTable | None = None
    hyoid: HyoidTable | None = None
    resection: list[ResectionTable] = Field(default=[], max_length=MOST_TABLES_OF_A_KIND, description="tissue that is removed")
    graft: list[GraftTable] = Field(
        default=[], max_length=MOST_TABLES_OF_A_KIND, description="flaps of other tissue, without muscle"
    )
    scar: ScarTable | None = Field(default=None, description="stiffer tissue next to cuts and grafts")
    lips: LipsTable | None = None
    effects: EffectsTable = EffectsTable()
    analysis: AnalysisTable
    record: RecordTable = RecordTable()

    @model_validator(mode="after")
    def _samples_can_be_stored(self) -> TransientScenario:
        samples = self.analysis.duration_ms / self.record.every_ms
        if samples > MOST_SAMPLES:
            raise ValueError(
                f"analysis.duration_ms = {self.analysis.duration_ms:g} and record.every_ms = {self.record.every_ms:g} make "
                f"{samples:.2g} samples; at most {MOST_SAMPLES} are possible, so take a longer every_ms"
            )
        return self

    @model_validator(mode="after")
    def _bodies_have_names(self) -> TransientScenario:
        names = [one.name for one in self.body]
        if len(set(names)) < len(names):
            raise ValueError("two [[body]] tables have one name; rename one of them")
        if self.body and (self.resection or self.graft):
            raise ValueError("surgery of several bodies is not supported; remove [[resection]] and [[graft]], or [[body]]")
        return self

    @model_validator(mode="after")
    def _bones_that_move_are_tied(self) -> TransientScenario:
        if self.hyoid is not None and self.model.attachment != "area":
            raise ValueError('[hyoid] needs model.attachment = "area": nodes that are held do not give way')
        if self.jaw is not None and self.model.attachment != "area":
            raise ValueError('[jaw] needs model.attachment = "area": nodes that are held do not move with the jaw')
        return self

    @model_validator(mode="after")
    def _scars_have_a_cause(self) -> TransientScenario:
        if self.scar is not None and not (self.resection or self.graft):
            raise ValueError("[scar] needs a [[resection]] or a [[graft]], next to which the tissue is a scar")
        return self

    @property
    def file_names(self) -> tuple[str, ...]:
        """The files that it names, relative to its own: a model file, surfaces of bones, paths."""
        names = [self.model.file, *(body.file for body in self.body), *(bone.file for bone in self.bone)]
        names += [table.path_file for table in (*self.motion, *self.bone)]
        return tuple(name for name in names if name is not None)

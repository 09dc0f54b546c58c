"""Colours of decoded pictures: what a file says of them, and pictures that browsers show alike.

Code points of matrices, primaries and transfer characteristics are those of ITU-T H.273, which
FFmpeg and H.264 share.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from av.codec.context import CodecContext
from av.filter import Graph
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame
from av.video.reformatter import ColorRange, Interpolation

from .video_info import UnreadableVideoError

_RGB, _BT709, _UNSPECIFIED, _SMPTE170M = 0, 1, 2, 6
#: Transfers of high dynamic range: PQ (SMPTE ST 2084) and HLG (ARIB STD-B67).
HDR_TRANSFERS = (16, 18)
#: Y'CbCr matrices that swscale converts: BT.709, FCC, BT.601 (two numbers), SMPTE 240M, BT.2020.
_MATRICES = (1, 4, 5, 6, 7, 9)
#: Primaries wider than those of ordinary screens: BT.2020, DCI-P3, Display P3.
_WIDE_PRIMARIES = (9, 11, 12)
#: A picture of fewer lines that does not name its matrix is taken for BT.601, as in Chromium.
_LINES_OF_HD = 720
#: The H.264 profiles whose sequence header has a chroma format, and the type of that header.
_HIGH_PROFILES = (100, 110, 122, 244, 44)
_SPS = 7
_INTERPOLATION = int(Interpolation.BICUBIC | Interpolation.ACCURATE_RND)


@dataclass(frozen=True)
class Colours:
    """How the numbers of a picture become colours. Without a matrix it is RGB or grey."""

    matrix: int | None
    primaries: int
    transfer: int
    is_full_range: bool

    @property
    def is_hdr(self) -> bool:
        """Whether it has a high dynamic range."""
        return self.transfer in HDR_TRANSFERS


def colours_of(frame: VideoFrame, context: CodecContext | None = None) -> Colours:
    """What `frame` says of its colours, and the usual meaning of what it leaves out.

    context: of its decoder. Raises UnreadableVideoError for a matrix that cannot be converted.
    """
    name = frame.format.name
    primaries = _BT709 if frame.color_primaries == _UNSPECIFIED else frame.color_primaries
    transfer = _BT709 if frame.color_trc in (_UNSPECIFIED, 0) else frame.color_trc
    is_grey = name.startswith(("gray", "ya8", "ya16", "mono"))
    if frame.format.is_rgb or frame.format.has_palette or is_grey:
        # FFmpeg's TIFF reader calls every grey picture one of gamma 2.2.
        transfer = transfer if transfer in HDR_TRANSFERS else _BT709
        return Colours(None, primaries, transfer, is_full_range=True)
    matrix = frame.colorspace
    if matrix == _UNSPECIFIED:
        matrix = _SMPTE170M if frame.height < _LINES_OF_HD else _BT709
    if matrix not in _MATRICES:
        raise UnreadableVideoError(f"its colours have the matrix {matrix} of ITU-T H.273")
    is_full = frame.color_range == ColorRange.JPEG or name.startswith("yuvj")
    if frame.color_range == ColorRange.UNSPECIFIED and is_monochrome(context):
        # FFmpeg writes grey pictures in full range, and H.264 of them without saying so.
        is_full = True
    return Colours(matrix, primaries, transfer, is_full)


class ColourConverter:
    """Turns pictures of one video into 8-bit 4:2:0 of limited range, in colours that are tagged.

    Matrix, primaries and transfer stay as they were recorded where browsers show them. RGB, grey,
    wide gamut and high dynamic range become BT.709; the last is tone-mapped.
    """

    def __init__(self, colours: Colours, width: int, height: int) -> None:
        """width, height: of what comes out, in pixels."""
        self._given = colours
        self._size = (width, height)
        self._is_kept = not colours.is_hdr and colours.primaries not in _WIDE_PRIMARIES
        is_bt709 = colours.matrix is None or not self._is_kept
        self._matrix = _BT709 if is_bt709 else colours.matrix or _BT709
        self._tone_mapping: tuple[tuple[object, ...], Graph] | None = None

    def tag(self, context: VideoCodecContext) -> None:
        """Write into an encoder's context what the pictures are."""
        context.color_range = int(ColorRange.MPEG)
        context.colorspace = self._matrix
        context.color_primaries = self._given.primaries if self._is_kept else _BT709
        context.color_trc = self._given.transfer if self._is_kept else _BT709

    def convert(self, frame: VideoFrame) -> VideoFrame:
        """`frame`, in the size and colours of this converter."""
        given = self._given
        frame.colorspace = _RGB if given.matrix is None else given.matrix
        frame.color_range = int(ColorRange.JPEG if given.is_full_range else ColorRange.MPEG)
        frame.color_primaries, frame.color_trc = given.primaries, given.transfer
        if given.is_hdr:
            return self._tone_mapped(frame)
        return frame.reformat(
            *self._size,
            format="yuv420p",
            dst_colorspace=_swscale_number(self._matrix),
            interpolation=_INTERPOLATION,
            dst_color_range=ColorRange.MPEG,
            dst_color_trc=None if self._is_kept else _BT709,
            dst_color_primaries=None if self._is_kept else _BT709,
        )

    def _tone_mapped(self, frame: VideoFrame) -> VideoFrame:
        """Through FFmpeg's scaler, whose perceptual intent maps the brightness range."""
        form = (frame.format.name, frame.width, frame.height)
        if self._tone_mapping is None or self._tone_mapping[0] != form:
            self._tone_mapping = (form, self._graph(frame))
        graph = self._tone_mapping[1]
        graph.vpush(frame)
        return graph.vpull()

    def _graph(self, frame: VideoFrame) -> Graph:
        graph = Graph()
        width, height = self._size
        time_base = frame.time_base or Fraction(1, 1000)
        nodes = (
            graph.add(
                "buffer",
                f"video_size={frame.width}x{frame.height}:pix_fmt={frame.format.name}"
                f":time_base={time_base}:colorspace={frame.colorspace}:range={frame.color_range}",
            ),
            graph.add(
                "scale",
                f"{width}:{height}:flags=bicubic+accurate_rnd:intent=perceptual:out_range=tv"
                ":out_color_matrix=bt709:out_primaries=bt709:out_transfer=bt709",
            ),
            graph.add("format", "pix_fmts=yuv420p"),
            graph.add("buffersink"),
        )
        graph.link_nodes(*nodes).configure()
        return graph


def _swscale_number(matrix: int) -> int:
    """What swscale calls a matrix: it has one number for both of BT.601."""
    return 5 if matrix in (5, 6) else matrix


def is_monochrome(context: CodecContext | None) -> bool:
    """Whether a decoder reads H.264 without colours, which FFmpeg gives as 4:2:0 with grey ones.

    ITU-T H.264, 7.3.2.1.1: after 4 bytes come seq_parameter_set_id, here 0, and chroma_format_idc,
    both as ue(v), where 0 is a single 1.
    """
    if context is None or context.name != "h264" or context.extradata is None:
        return False
    extradata = bytes(context.extradata)
    # An avcC box holds the header after 8 bytes of its own; other files have it after a start code.
    start = 8 if extradata[:1] == b"\1" else extradata.find(b"\0\0\1") + 3
    header = extradata[start : start + 5]
    if len(header) < 5:
        return False
    return header[0] & 31 == _SPS and header[1] in _HIGH_PROFILES and header[4] >> 6 == 0b11

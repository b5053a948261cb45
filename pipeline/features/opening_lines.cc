// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/opening_lines.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <map>
#include <optional>
#include <utility>

#include "pipeline/features/ray_numbers.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct MissedSettings {
  // Of the length-weighted mean gap: samples nearer to each other are of one line.
  double one_crossing = 0.25;
  // Of the gap between lines: gaps are as many of it as there are, give or take this.
  double even = 0.2;
  // Of a strip's gaps: so many are even; so many, but for one, are of one line to the next.
  double least_even = 0.85, least_single = 0.9;
  // Strips of a pass, tried from the most on: as narrow as its rays lie apart, they are crossed by
  // every line. Of those with samples so many are.
  std::array<std::size_t, 8> strips = {128, 96, 64, 48, 32, 24, 16, 12};
  double least_strips = 0.7;
  std::size_t least_lines = 5;
  // Of the distance of lines: so near to where a line goes on its samples are.
  double same_line = 0.3;
  // Parts of the width of a pass, over which the distance of its rays is about even; it is taken
  // over so many rays, whose noise it thereby holds down.
  std::size_t parts = 24, over_rays = 4;
  std::size_t least_rises = 8;  // of lines that tell how they are slanted in a part
  // [of the distance of rays] and [1 sigma of it] Where neighbours in a line are further from each
  // other, rays are missing between them.
  double missing = 1.5, missing_sigmas = 3.0;
  // [of the distance of rays] How well it is known where one is, beside how uneven they are.
  double known = 0.02;
  double parts_a_ray = 5.0;
  // [of the distance of rays] Of the distance of neighbours: 1 sigma of rays that are all there is
  // a tenth, and what noise adds, [of its 1 sigma] so much at most; of lines that were thinned
  // four.
  double most_uneven = 0.25, of_noise = 1.0;
  std::size_t most_missing = 400;  // of one line, one after the other: there nobody looked
};
constexpr MissedSettings kMissed;

struct Hit {
  Eigen::Vector2d place_mm;
  SensorDirection to_sensor;
};
using Strip = std::vector<Eigen::Vector2d>;

// Lines of a strip, each by the mean of its samples. `strip`: sorted along.
Strip LinesOf(const Strip& strip) {
  double sum = 0, sum2 = 0;
  for (std::size_t i = 1; i < strip.size(); ++i) {
    const double gap = strip[i].x() - strip[i - 1].x();
    sum += gap;
    sum2 += gap * gap;
  }
  // Holes are long gaps: the root holds their weight down.
  const auto n = static_cast<double>(std::max<std::size_t>(1, strip.size() - 1));
  const double one_line_mm =
      kMissed.one_crossing * std::sqrt(sum / n * sum2 / std::max(sum, 1e-12));
  Strip lines;
  for (std::size_t i = 0; i < strip.size();) {
    Eigen::Vector2d middle = Eigen::Vector2d::Zero();
    std::size_t end = i;
    for (; end < strip.size() && (end == i || strip[end].x() - strip[end - 1].x() < one_line_mm);
         ++end) {
      middle += strip[end];
    }
    lines.emplace_back(middle / static_cast<double>(end - i));
    i = end;
  }
  return lines;
}

// The distance of the lines of a strip, if even ones cross it.
std::optional<double> EvenGap(const Strip& strip) {
  const Strip lines = LinesOf(strip);
  if (lines.size() < kMissed.least_lines) return std::nullopt;
  std::vector<double> gaps;
  for (std::size_t i = 1; i < lines.size(); ++i) gaps.push_back(lines[i].x() - lines[i - 1].x());
  const double gap_mm = Median(gaps);
  double even = 0, single = 0;
  for (const double gap : gaps) {
    const double times = std::max(1.0, std::round(gap / gap_mm));
    if (std::abs(gap / gap_mm - times) > kMissed.even * std::max(1.0, 0.1 * times)) continue;
    even += 1;
    single += times == 1 ? 1 : 0;
  }
  const auto n = static_cast<double>(gaps.size());
  if (even < kMissed.least_even * n || single + 1 < kMissed.least_single * n) return std::nullopt;
  return gap_mm;
}

// One pass over the wall about a place.
class Pass {
 public:
  // `hits`: sorted along.
  Pass(std::vector<Hit> hits, double noise_mm) : hits_(std::move(hits)), noise_mm_(noise_mm) {
    low_mm_ = 1e300, high_mm_ = -1e300;
    for (const Hit& hit : hits_) {
      low_mm_ = std::min(low_mm_, hit.place_mm.y());
      high_mm_ = std::max(high_mm_, hit.place_mm.y());
    }
  }

  // Whether it comes in lines of even rays; adds the rays that met nothing, with cells but without
  // what is known of the directions.
  bool AddMissed(std::vector<MissedRay>& rays) {
    if (!(high_mm_ > low_mm_) || !FindGap()) return false;
    FindLines();
    Level();
    FindLines();
    if (!FindNumbers()) return false;
    FindSides();
    const std::size_t before = rays.size();
    for (const Line& line : lines_) AddMissedOf(line, rays);
    for (std::size_t i = before; i < rays.size(); ++i) {
      rays[i].place_mm.x() += SlantMm(rays[i].place_mm.y());
    }
    return true;
  }

 private:
  struct Line {
    std::vector<Hit> hits;  // sorted round the tube

    // Where it goes on.
    double AlongAt(double y_mm, double gap_mm) const {
      const Eigen::Vector2d &first = hits.front().place_mm, &last = hits.back().place_mm;
      const double across_mm = last.y() - first.y();
      if (across_mm < gap_mm) return last.x();
      return last.x() + (last.x() - first.x()) / across_mm * (y_mm - last.y());
    }
  };

  bool FindGap() {
    for (const std::size_t count : kMissed.strips) {
      std::vector<Strip> strips(count);
      for (const Hit& hit : hits_) strips[PartOf(hit.place_mm.y(), count)].push_back(hit.place_mm);
      double with_samples = 0;
      std::vector<double> gaps;
      for (const Strip& strip : strips) {
        if (strip.empty()) continue;
        with_samples += 1;
        if (const auto gap_mm = EvenGap(strip)) gaps.push_back(*gap_mm);
      }
      if (static_cast<double>(gaps.size()) < kMissed.least_strips * with_samples) continue;
      gap_mm_ = Median(gaps);
      return true;
    }
    return false;
  }

  // The laser of a scanner that is held askew meets the tube in curves: across a wide opening none
  // goes on as straight as it was before. All lines of a pass are slanted alike; levelled by that
  // each goes on where it is.
  void Level() {
    FindSlant();
    for (Hit& hit : hits_) hit.place_mm.x() -= SlantMm(hit.place_mm.y());
    std::sort(hits_.begin(), hits_.end(),
              [](const Hit& a, const Hit& b) { return a.place_mm.x() < b.place_mm.x(); });
  }
  // How far along lines are, from part to part round the tube: their usual rise, summed up.
  void FindSlant() {
    using Rise = std::optional<double>;
    std::vector<double> rise = UsualOfParts(
        kMissed.least_rises, [](const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
          return to.y() > from.y() ? Rise((to.x() - from.x()) / (to.y() - from.y())) : Rise();
        });
    rise.resize(kMissed.parts, 0.0);
    slant_mm_.assign(1, 0.0);
    for (const double of_part : rise) slant_mm_.push_back(slant_mm_.back() + of_part * PartMm());
  }
  double PartMm() const { return (high_mm_ - low_mm_) / static_cast<double>(kMissed.parts); }
  double SlantMm(double y_mm) const {
    const double at =
        std::clamp((y_mm - low_mm_) / PartMm(), 0.0, static_cast<double>(kMissed.parts) - 1e-9);
    const auto part = static_cast<std::size_t>(at);
    const double rest = at - static_cast<double>(part);
    return (1.0 - rest) * slant_mm_[part] + rest * slant_mm_[part + 1];
  }

  // Each hit, in their order round the tube, goes on the line that it continues.
  void FindLines() {
    lines_.clear();
    std::vector<Hit> around = hits_;
    std::sort(around.begin(), around.end(),
              [](const Hit& a, const Hit& b) { return a.place_mm.y() < b.place_mm.y(); });
    for (const Hit& hit : around) {
      // Lines do not cross each other, so they stay sorted along.
      auto behind = std::lower_bound(lines_.begin(), lines_.end(), hit.place_mm,
                                     [&](const Line& line, const auto& place) {
                                       return line.AlongAt(place.y(), gap_mm_) < place.x();
                                     });
      auto nearest = lines_.end();
      double nearest_mm = kMissed.same_line * gap_mm_;
      for (auto at : {behind, behind == lines_.begin() ? behind : std::prev(behind)}) {
        if (at == lines_.end()) continue;
        const double off_mm = std::abs(at->AlongAt(hit.place_mm.y(), gap_mm_) - hit.place_mm.x());
        if (off_mm < nearest_mm) nearest = at, nearest_mm = off_mm;
      }
      if (nearest == lines_.end()) nearest = lines_.insert(behind, Line{});
      nearest->hits.push_back(hit);
    }
  }

  // Which ray meets the wall where, if those of a line are even.
  bool FindNumbers() {
    const std::vector<double> pitch_mm = PitchesMm();
    if (pitch_mm.empty() || !(*std::min_element(pitch_mm.begin(), pitch_mm.end()) > 0)) {
      return false;
    }
    const auto pitch_at = [&](double y_mm) { return pitch_mm[PartOf(y_mm, pitch_mm.size())]; };
    std::vector<double> uneven_mm;
    std::vector<NeighbouringRays> neighbours;
    for (const Line& line : lines_) {
      for (std::size_t i = 1; i < line.hits.size(); ++i) {
        const double from_mm = line.hits[i - 1].place_mm.y(), to_mm = line.hits[i].place_mm.y();
        uneven_mm.push_back(std::abs(to_mm - from_mm - pitch_at(to_mm)));
        if (to_mm - from_mm < kMissed.missing * pitch_at(0.5 * (from_mm + to_mm))) {
          neighbours.push_back({from_mm, to_mm});
        }
      }
    }
    constexpr double kPerMedian = 1.4826;  // 1 sigma of normal errors over the median of their size
    if (!(kPerMedian * Median(std::move(uneven_mm)) <
          kMissed.most_uneven * Median(pitch_mm) + kMissed.of_noise * noise_mm_)) {
      return false;
    }
    numbers_ = RayNumbers::Of(neighbours);
    return numbers_.has_value();
  }

  // About how far rays lie apart round the tube, part by part.
  std::vector<double> PitchesMm() const {
    return UsualOfParts(1, [](const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
      return std::optional((to.y() - from.y()) / static_cast<double>(kMissed.over_rays));
    });
  }

  // The median of what stretches of lines say, each of some rays, part by part round the tube;
  // where fewer than `least` do, as in the part beside it. Empty: no part knows.
  template <class Value>
  std::vector<double> UsualOfParts(std::size_t least, Value value) const {
    std::vector<std::vector<double>> values(kMissed.parts);
    for (const Line& line : lines_) {
      for (std::size_t i = kMissed.over_rays; i < line.hits.size(); ++i) {
        const Eigen::Vector2d& from = line.hits[i - kMissed.over_rays].place_mm;
        const Eigen::Vector2d& to = line.hits[i].place_mm;
        const std::size_t part = PartOf(0.5 * (from.y() + to.y()), kMissed.parts);
        if (const auto said = value(from, to)) values[part].push_back(*said);
      }
    }
    std::vector<double> usual;
    for (std::size_t part = 0; part < values.size(); ++part) {
      if (values[part].size() < least) {
        if (!usual.empty()) usual.push_back(usual.back());
        continue;
      }
      const double of_part = Median(std::move(values[part]));
      if (usual.empty()) usual.assign(part, of_part);
      usual.push_back(of_part);
    }
    return usual;
  }

  // The first and the last line that reach each place round the tube.
  void FindSides() {
    const auto parts = static_cast<std::size_t>(std::clamp(
        kMissed.parts_a_ray * (numbers_->At(high_mm_) - numbers_->At(low_mm_)), 1.0, 4000.0));
    sides_.assign(parts, {1e300, -1e300});
    for (const Hit& hit : hits_) {
      auto& [first_mm, last_mm] = sides_[PartOf(hit.place_mm.y(), parts)];
      first_mm = std::min(first_mm, hit.place_mm.x());
      last_mm = std::max(last_mm, hit.place_mm.x());
    }
  }

  void AddMissedOf(const Line& line, std::vector<MissedRay>& rays) const {
    if (line.hits.size() < kMissed.least_lines) return;
    for (std::size_t i = 1; i < line.hits.size(); ++i)
      AddBetween(line.hits[i - 1], line.hits[i], rays);
    AddBeyond(line, true, rays);
    AddBeyond(line, false, rays);
  }

  // Rays of a line between two hits that follow each other.
  void AddBetween(const Hit& from, const Hit& to, std::vector<MissedRay>& rays) const {
    const double from_mm = from.place_mm.y(), to_mm = to.place_mm.y();
    const double first = numbers_->At(from_mm), steps = numbers_->At(to_mm) - first;
    const double whole = std::round(steps);
    if (steps < kMissed.missing + kMissed.missing_sigmas * numbers_->uneven() ||
        whole > static_cast<double>(kMissed.most_missing)) {
      return;
    }
    for (double i = 1; i < whole; ++i) {
      const double y_mm =
          numbers_->PlaceMm(first + i / whole * steps, from_mm + i / whole * (to_mm - from_mm));
      const double part = (y_mm - from_mm) / (to_mm - from_mm);
      Add({from.place_mm.x() + part * (to.place_mm.x() - from.place_mm.x()), y_mm},
          part < 0.5 ? from.to_sensor : to.to_sensor, rays);
    }
  }

  // Rays of a line before its first or after its last hit, as far as other lines of the pass go.
  void AddBeyond(const Line& line, bool is_after, std::vector<MissedRay>& rays) const {
    const Hit& from = is_after ? line.hits.back() : line.hits.front();
    const double way = is_after ? 1.0 : -1.0;
    const double first = numbers_->At(from.place_mm.y());
    double y = from.place_mm.y();
    for (std::size_t i = 1; i <= kMissed.most_missing; ++i) {
      y = numbers_->PlaceMm(first + way * static_cast<double>(i), y + way * numbers_->PitchMm(y));
      const Eigen::Vector2d place(from.place_mm.x(), y);
      if (y < low_mm_ || y > high_mm_ || MeetsWall(place, from.place_mm.y(), way)) return;
      Add(place, from.to_sensor, rays);
    }
  }

  void Add(const Eigen::Vector2d& place_mm, SensorDirection to_sensor,
           std::vector<MissedRay>& rays) const {
    const std::size_t part = PartOf(place_mm.y(), sides_.size());
    double first_mm = 1e300, last_mm = -1e300;
    // Half a ray to either side.
    constexpr auto kHalf = static_cast<std::size_t>(0.5 * kMissed.parts_a_ray);
    for (std::size_t i = part - std::min(part, kHalf);
         i < std::min(part + kHalf + 1, sides_.size()); ++i) {
      first_mm = std::min(first_mm, sides_[i].first);
      last_mm = std::max(last_mm, sides_[i].second);
    }
    if (first_mm > place_mm.x() - 0.5 * gap_mm_ || last_mm < place_mm.x() + 0.5 * gap_mm_) return;
    const double pitch_mm = numbers_->PitchMm(place_mm.y());
    rays.push_back({place_mm, std::hypot(kMissed.known, 0.5 * numbers_->uneven()) * pitch_mm,
                    pitch_mm * gap_mm_, to_sensor});
  }

  // Whether hits lie about a place and on this way from where its line was left: it goes on there.
  bool MeetsWall(const Eigen::Vector2d& place_mm, double from_mm, double way) const {
    const double near_mm =
        (1.0 + kMissed.missing_sigmas * numbers_->uneven()) * numbers_->PitchMm(place_mm.y());
    const auto first =
        std::lower_bound(hits_.begin(), hits_.end(), place_mm.x() - kMissed.same_line * gap_mm_,
                         [](const Hit& hit, double at_mm) { return hit.place_mm.x() < at_mm; });
    for (auto at = first;
         at != hits_.end() && at->place_mm.x() < place_mm.x() + kMissed.same_line * gap_mm_; ++at) {
      const double y_mm = at->place_mm.y();
      if (way * (y_mm - from_mm) > 0 && std::abs(y_mm - place_mm.y()) < near_mm) return true;
    }
    return false;
  }

  std::size_t PartOf(double y_mm, std::size_t count) const {
    const double part = (y_mm - low_mm_) / (high_mm_ - low_mm_) * static_cast<double>(count);
    return std::min(count - 1, static_cast<std::size_t>(std::max(0.0, part)));
  }

  std::vector<Hit> hits_;
  double noise_mm_;
  double low_mm_ = 0, high_mm_ = 0;  // round the tube
  double gap_mm_ = 0;                // of its lines
  std::vector<double> slant_mm_;     // of its lines, where parts round the tube begin and end
  std::vector<Line> lines_;          // sorted along
  std::optional<RayNumbers> numbers_;
  std::vector<std::pair<double, double>> sides_;
};

}  // namespace

MissedRays FindMissed(std::span<const WallSample> wall, double pipe_radius_mm, double noise_mm,
                      const Eigen::Vector3d& outward, const Eigen::Vector3d& sideways) {
  std::map<unsigned, std::vector<Hit>> passes;
  for (const WallSample& sample : wall) {
    if (!sample.to_sensor.known()) continue;
    passes[PassOf(sample.to_sensor)].push_back({sample.place_mm, sample.to_sensor});
  }
  MissedRays missed;
  for (auto& [number, hits] : passes) {
    std::sort(hits.begin(), hits.end(),
              [](const Hit& a, const Hit& b) { return a.place_mm.x() < b.place_mm.x(); });
    if (Pass(std::move(hits), noise_mm).AddMissed(missed.rays)) {
      missed.has_lines = true;
    } else {
      missed.scattered.push_back(number);
    }
  }
  std::erase_if(missed.rays, [&](const MissedRay& ray) {
    const double turn = ray.place_mm.y() / pipe_radius_mm;
    const Eigen::Vector3d normal = std::cos(turn) * outward + std::sin(turn) * sideways;
    return TowardsSensor(ray.to_sensor).dot(normal) < kLeastRayCosine;
  });
  return missed;
}

}  // namespace bendloop::pipeline
